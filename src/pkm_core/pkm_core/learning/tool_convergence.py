"""
Convergence test of learning at the tool, together with the law of the joints, before its use.

At one frequency, with T from reference to slider (feedforward included), G from learned feedforward to slider, and H
from slider to tool in slider lengths, the two signals of an axis go from cycle to cycle by

    dr <- dr - gain LP ((1 + (H - 1) T) dr + (H - 1) G u) + ...
    u  <- M u + joint_gain A ((1 - T) dr - G u) + ...

H is 1 for a rigid tool with an exact Jacobian. It is tested with the error of the Jacobian, and with a mode at
`lowest_mode`, H = 1 + f^2/(f1^2 - f^2 + 2 i d f1 f); higher modes change less. The law passes if the larger eigenvalue
is below 1 within its band, for all `perturbed_models`, the largest and the least gain at the tool, and all gains of the
joints. Above its resonance a mode turns the sign of the correction, which then diverges.
"""

import numpy as np

from pkm_core.control.axis import feedforward_gains
from pkm_core.control.margins import perturbed_models, unit_circle
from pkm_core.control.systems import plant_system
from pkm_core.errors import LearningError
from pkm_core.learning.convergence import SLOWEST, STEP, Convergence
from pkm_core.learning.law import path_through


def tool_convergence(config, machine, gains, model, law, joint):
    """
    Return the `Convergence` of learning at the tool on `joint`.

    Parameters
    ----------
    config : ToolLawConfig
        Of learning at the tool.
    machine : Machine
        For its sample time.
    gains : RobustGains
        Of the joint.
    model : AxisModel
        Of the joint.
    law : Law or None
        That of the joints.
    joint : str
        Name of the joint.

    """
    sample_time = machine.sample_time
    frequency = np.concatenate([[SLOWEST, 0.5], np.arange(STEP, config.zero_at, STEP)])
    z, s = unit_circle(frequency, sample_time), 2j * np.pi * frequency
    kv, ka, kj = feedforward_gains(gains, model, sample_time)
    pid, forward = gains.pid_response(z, sample_time), kv * s + ka * s**2 + kj * s**3
    M = law.memory(joint, frequency) if law else np.zeros(frequency.shape)
    A = law.action(joint, frequency) if law else np.zeros(frequency.shape)
    # axes: responses of the tool, gains at the tool, gains of the joints, frequencies
    H = _tools(config, frequency)[:, None, None, :]
    step = np.array([[max(config.gain)], [min(config.gain)]])[:, None, :] * config.weight(frequency)
    A = np.array(sorted(set(law.config.gain) if law else {0.0}))[:, None] * A
    models, factor, plants = perturbed_models(model, uncertainty=gains.uncertainty), [], {}
    for each in models:
        if each.modes not in plants:
            plants[each.modes] = plant_system(each, sample_time)(z) / each.gain
        G = path_through(gains, each.gain * plants[each.modes], z, sample_time)
        T = G * (pid + forward)
        eigenvalue = _larger_eigenvalue(1 - step * (1 + (H - 1) * T), -step * (H - 1) * G, A * (1 - T), M - A * G)
        factor.append(eigenvalue.max(axis=(0, 1, 2)))
    return Convergence(tuple(models), frequency, np.array(factor))


def _tools(config, frequency):
    """Return the tested responses H (6, F) from slider to tool."""
    f1, error = config.lowest_mode, config.jacobian_error
    mode = 1 + frequency**2 / (f1**2 - frequency**2 + 2j * config.mode_damping * f1 * frequency)
    return np.array([(1 + side * error) * shape for shape in (np.ones_like(mode), mode) for side in (0, -1, 1)])


def _larger_eigenvalue(a, b, c, d):
    """Return the larger magnitude of the eigenvalues of [[a, b], [c, d]]."""
    half, root = 0.5 * (a + d), np.sqrt(0.25 * (a - d) ** 2 + b * c + 0j)
    return np.maximum(np.abs(half + root), np.abs(half - root))


def check_tool_law(config, machine, gains, models, law):
    """
    Return the verdict on learning at the tool, a text.

    Parameters
    ----------
    config : ToolLawConfig
        Of learning at the tool.
    machine : Machine
        For its sample time.
    gains, models : dict of str to RobustGains, AxisModel
        By joint.
    law : Law or None
        That of the joints.

    Raises
    ------
    LearningError
        If it diverges on a joint; the message has factor, frequency and model.

    """
    found = {joint: tool_convergence(config, machine, gains[joint], models[joint], law, joint) for joint in gains}
    joint = max(found, key=lambda each: found[each].worst)
    worst = found[joint]
    if not worst.worst < 1:
        raise LearningError(
            f'learning at the tool would diverge: the error of {joint} at {worst.worst_frequency:.1f} Hz is multiplied '
            f'by {worst.worst:.3f} per cycle ({worst.worst_model}); allowed below 1'
        )
    flat = max(each.factor[:, each.frequency <= config.flat_to].max() for each in found.values())
    return (
        f'learning at the tool converges: the error up to {config.flat_to:g} Hz is multiplied by at most {flat:.3f} '
        f'per cycle'
    )
