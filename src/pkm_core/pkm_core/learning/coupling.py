"""
Feedforward of the coupling forces of the nominal design, which controllers of single axes do not include.

Partners of a pair couple by 4 % of their acceleration, and inertia, Coriolis and gravity forces change with the
position. These forces are in M, C and G of the nominal design; nothing is learned or measured. Like a learned
feedforward they are filtered by the inverse of filters, delay, drive and modes: at the slider they act as forces.
"""

import numpy as np

from pkm_core.learning import untested_law


def design_feedforward(machine, gains, trajectory):
    """
    Return the feedforward (N, n) [V] of a `SampledTrajectory` in joints under the gains `gains` of `load_control`.

    It is that of the basis law with the parameters known by design: 1 for all couplings and the configuration, 0 for
    all others. A share that the model's `forces` already include is left out.
    """
    law = untested_law('basis', machine, gains).with_reference(trajectory)  # untested: it makes no update
    columns = []
    for joint in machine.joints:
        names = law.parameters(joint, np.zeros(len(trajectory)))
        known = {f'acceleration_{other}' for other in machine.joints} | {'configuration'}
        forces = law.models[joint].forces
        share = 1.0 - (0.0 if forces is None else forces.coupling)
        columns.append(law.feedforward(joint, {name: share * (name in known) for name in names}))
    return np.stack(columns, axis=1)
