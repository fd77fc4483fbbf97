"""Write identified models as a file of config/model, with the uncertainty of every value."""

from pathlib import Path

from pkm_core.control.model import load_model
from pkm_core.errors import PkmError
from pkm_core.identification import IdentificationError


def write_model(path, machine, found, believed, origin):
    """
    Write a file for `load_model`, and return {joint: AxisModel} as read back from it.

    Parameters
    ----------
    path : Path
        The file.
    machine : Machine
        Machine of the axes.
    found : dict of str to AxisIdentification
        Identified joints.
    believed : dict of str to AxisModel
        Present models; copied for joints not in `found`.
    origin : str
        Command that produced the file, for its header.

    """
    lines = [
        f'# Axis models of {machine.name} for its controllers, (7.18)-(7.20).',
        f'# Identified by `{origin}`; +- is one standard deviation.',
        'joints:',
    ]
    for joint in machine.joints:
        prior = believed[joint]
        axis = found.get(joint)
        model = axis.model(prior.current_loop) if axis else prior
        if model.forces is None:
            model = model.model_copy(update={'forces': prior.forces})
        lines += [f'  {joint}:', *_axis_lines(model, axis), *_force_lines(model.forces, axis and axis.forces)]
    path = Path(path)
    try:
        path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    except OSError as error:
        raise IdentificationError(f'{path}: cannot be written: {error.strerror}') from None
    try:
        return load_model(machine, path)
    except PkmError:
        path.unlink()  # leave no invalid model file behind
        raise


def _axis_lines(model, axis):
    if axis is None:
        gain = viscosity = 'not identified'
        modes = [('not identified',) * 4 for _ in model.modes]
    else:
        deviations = axis.low.deviations
        correlation = axis.low.covariance[0, 1] / deviations.prod()
        gain = f'K +- {1e3 * deviations[0]:.3g}'
        viscosity = f'a +- {deviations[1]:.3g}, correlation with K {correlation:.3f}'
        rows = axis.high.deviations if axis.high else []
        modes = [(f'+- {f:.2g}', f'+- {z:.2g}', f'+- {fa:.2g}', f'+- {za:.2g}') for f, z, fa, za in rows]
    yield f'    gain: {1e3 * model.gain:.7g} mm/s^2/V  # {gain}'
    yield f'    viscosity: {model.viscosity:.6g} 1/s  # {viscosity}'
    yield f'    current_loop: {model.current_loop:.7g} Hz  # taken as known'
    yield '    modes:' if model.modes else '    modes: []  # not identified'
    for mode, notes in zip(model.modes, modes, strict=True):
        yield f'      - resonance: {mode.resonance:.7g} Hz  # {notes[0]}'
        yield f'        resonance_damping: {mode.resonance_damping:.6g}  # {notes[1]}'
        yield f'        antiresonance: {mode.antiresonance:.7g} Hz  # {notes[2]}'
        yield f'        antiresonance_damping: {mode.antiresonance_damping:.6g}  # {notes[3]}'


def _force_lines(forces, fit):
    """Yield the section `forces`; `fit` is the `ForcesFit` of this identification, if any."""
    if forces is None:
        return
    notes = {name: f'+- {value:.2g}' for name, value in fit.deviations.items()} if fit else {}
    if fit:
        notes |= {'slip': 'scanned', 'coupling': 'taken as known: the nominal design'}
        notes['pitch'] = 'scanned' if 'ripple_sine' in notes else 'not identified, without effect'
    units = {'coulomb': ' V', 'slip': ' m', 'pitch': ' m', 'cogging_sine': ' V', 'cogging_cosine': ' V'}
    yield '    forces:  # as the drive voltage that balances them'
    for name, value in forces:
        yield f'      {name}: {value:.5g}{units.get(name, "")}  # {notes.get(name, "not identified")}'
