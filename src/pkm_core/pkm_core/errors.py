"""The errors of pkm_core; every message has the form `where: what came (unit); allowed: range`."""


class PkmError(ValueError):
    """Base of all errors that this library raises on purpose."""


class ConfigError(PkmError):
    """A configuration file or value is refused."""


class WorkspaceError(PkmError):
    """A pose or joint position is out of the mechanism's reach."""


class TrajectoryError(PkmError):
    """A motion or trajectory is refused."""


class FollowError(TrajectoryError):
    """
    A goal of FollowJointTrajectory is refused or was not followed.

    Attributes
    ----------
    code : str
        Name of the constant in the result of control_msgs/FollowJointTrajectory.

    """

    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


class LearningError(PkmError):
    """A learning request is refused."""


class BagError(PkmError):
    """A bag cannot be written or read."""
