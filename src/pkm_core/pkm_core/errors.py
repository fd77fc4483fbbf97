"""The errors a caller of pkm_core may want to tell apart; every text says where, what came and what is allowed."""


class PkmError(ValueError):
    """Base of all refusals of this library."""


class ConfigError(PkmError):
    """A configuration file or value is refused."""


class WorkspaceError(PkmError):
    """A pose or joint position lies outside what the mechanism can reach."""


class TrajectoryError(PkmError):
    """A motion or trajectory is refused."""


class LearningError(PkmError):
    """A learning request is refused."""


class BagError(PkmError):
    """A bag cannot be written or read."""
