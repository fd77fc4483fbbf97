"""
The feedforward that the nominal design asks for and a controller of single axes has not: what the others do to an axis.

Partners of a pair couple by 4 % of their acceleration, and inertia, Coriolis and gravity forces change with the
position. All that is in M, C and G of the design, which everybody knows; nothing is learned or measured. It takes the
way of a learned feedforward: through the inverse of filters, delay, drive and modes, so that it arrives as a force.
"""

import numpy as np

from pkm_core.learning import untested_law


def design_feedforward(machine, control, trajectory):
    """
    Return the feedforward (N, n) [V] of a `SampledTrajectory` in joints under the gains `control` of `load_control`.

    It is that of the basis law with the parameters known by design: 1 of all couplings and of the configuration, 0 of
    what only learning finds.
    """
    law = untested_law('basis', machine, control).with_reference(trajectory)  # which learns nothing here
    columns = []
    for joint in machine.joints:
        names = law.parameters(joint, np.zeros(len(trajectory)))
        known = {f'acceleration_{other}' for other in machine.joints} | {'configuration'}
        columns.append(law.feedforward(joint, {name: float(name in known) for name in names}))
    return np.stack(columns, axis=1)
