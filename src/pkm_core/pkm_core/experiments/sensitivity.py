"""
Sensitivity of the learned error to the chosen constants of the simulated machine.

One constant of the truth file at a time takes a lower and a higher level; controllers, models and learning law stay as
shipped. Errors are those of the worst axis by the encoders. Effects of two constants together are not included.
"""

from dataclasses import dataclass

import numpy as np

from pkm_core.experiments.condition import conditions, prepared
from pkm_core.experiments.outcome import spread
from pkm_core.plant.changed_truth import changed_machine
from pkm_core.reporting.tables import Table
from pkm_core.simulation.cycles import run_cycles

UM = 1e6
MACHINES = {'four_dof': '4-DOF', 'planar': 'planar'}
ENVIRONMENT = 'nominal'
LEVELS = ('low', 'high')


@dataclass(frozen=True)
class Constant:
    """
    One constant: `keys` of the truth file, '*' for all of a level, and the two values it takes.

    A float is a factor on the shipped value; every other value replaces it, and None leaves the level out.
    """

    name: str
    keys: tuple[str, ...]
    low: object
    high: object

    def applied(self, level):
        """Return the function that gives the constant its 'low' or 'high' value in a truth file."""
        value = getattr(self, level)

        def change(truth):
            for key in self.keys:
                for holder, last in _places(truth, key.split('.')):
                    holder[last] = _scaled(holder[last], value) if isinstance(value, float) else value

        return change

    def text(self, level):
        """Return the value of a level as the table shows it."""
        value = getattr(self, level)
        if isinstance(value, list):
            return f'{value[0].split()[0]} to {value[1]}'
        return f'x {value:g}' if isinstance(value, float) else {None: '', False: 'off'}.get(value, str(value))


def _level(key, low, high, name=''):
    return Constant(name or key.replace('_', ' '), (f'environments.{ENVIRONMENT}.{key}',), low, high)


CONSTANTS = (
    _level('coulomb_friction', '0 N', '2 N', 'Coulomb friction'),
    _level('friction_jitter', '0 %', '10 %'),
    _level('gain_jitter', '0 %', '0.5 %'),
    _level('ripple', '0 %', '3 %'),
    _level('cogging', '0 N', '0.2 N'),
    _level('amplifier_noise', '0 mV', '5 mV'),
    _level('floor_vibration', '0 mm/s^2', '8 mm/s^2'),
    _level('encoder_noise', '0', '2'),
    _level('subdivision_error', '0 nm', '80 nm'),
    _level('encoder_latency', '0 us', '20 us'),
    _level('payload_spread', '0 %', '5 %'),
    _level('mode_shift', '-3 %', '3 %'),
    _level('mode_shift', '0.5 %', '1 %', 'mode shift, small'),
    _level('mode_shift', '2 %', '5 %', 'mode shift, large'),
    _level('back_emf', False, None, 'back EMF'),
    _level('modes', False, None),
    Constant('gain error of the axes', ('axes.*.gain_error',), 0.0, 2.0),
    Constant('viscosity error of the axes', ('axes.*.viscosity_error',), 0.0, 2.0),
    Constant('frequencies of the modes', ('axes.*.modes.*.resonance', 'axes.*.modes.*.antiresonance'), 0.95, 1.05),
    Constant(
        'dampings of the modes', ('axes.*.modes.*.resonance_damping', 'axes.*.modes.*.antiresonance_damping'), 0.5, 2.0
    ),
    Constant('bits of the converter', ('drive.dac_bits',), 12, 20),
    Constant('pitch of the magnets', ('drive.pitch',), '20 mm', '60 mm'),
    Constant('presliding stiffness', ('friction.stiffness',), 0.5, 2.0),
    Constant('presliding damping', ('friction.damping',), 0.5, 2.0),
    Constant('elastic share of presliding', ('friction.elastic',), '0.25', '0.75'),
    Constant('breakaway over Coulomb force', ('friction.breakaway',), '1.0', '1.5'),
    Constant('Stribeck speed', ('friction.stribeck_speed',), '2 mm/s', '20 mm/s'),
    Constant('signal period of the encoder', ('signal_period',), '10 um', '40 um'),
    Constant('band of the floor vibration', ('vibration_band',), ['5 Hz', '20 Hz'], ['80 Hz', '200 Hz']),
    Constant('thermal time of the motors', ('drive.thermal_time',), '2 s', '50 s'),
    Constant('step of the integration', ('substep',), '31.25 us', '125 us'),
)


def _places(node, keys):
    """Yield (holder, key) of all places of a YAML mapping that `keys` name."""
    first, *rest = keys
    chosen = (range(len(node)) if isinstance(node, list) else list(node)) if first == '*' else [first]
    for key in chosen:
        if rest:
            yield from _places(node[key], rest)
        else:
            yield node, key


def _scaled(text, factor):
    """Return a quantity of a file times `factor`, in its unit."""
    number, _, unit = str(text).partition(' ')
    return f'{factor * float(number)!r} {unit}'.strip()


def sensitivity_tasks(seeds, cycles):
    """Return {key: tuple of a function and its arguments} of all runs, for `farm`; a key is (machine, name, level)."""
    changes = [('shipped', '')] + [
        (constant.name, level) for constant in CONSTANTS for level in LEVELS if getattr(constant, level) is not None
    ]
    return {
        (machine, *change, seed): (learned_error, machine, *change, seed, cycles)
        for machine in MACHINES
        for change in changes
        for seed in range(1, seeds + 1)
    }


def learned_error(machine_name, name, level, seed, cycles):
    """
    Return the largest error [m] of the worst axis in each of `cycles` cycles, after the best law has converged.

    The constant `name` of `CONSTANTS` has its 'low' or 'high' level; level '' leaves all as shipped.
    """
    condition = {each.name: each for each in conditions(machine_name)}['best law']
    given = prepared(condition)
    chosen = {constant.name: constant for constant in CONSTANTS}
    change = chosen[name].applied(level) if level else lambda truth: None
    with changed_machine(given.machine, ENVIRONMENT, change) as machine:
        records = run_cycles(
            machine, given.joints, given.gains, given.law, condition.settled + cycles, seed, ENVIRONMENT, given.start
        )
    return records.metric('max_dynamic_error').max(axis=1)[condition.settled :]


def sensitivity(results):
    """Return {machine: {(name, level): `Spread` [um]}} for {key: result} of `sensitivity_tasks`."""
    found: dict = {machine: {} for machine in MACHINES}
    for (machine, name, level, _), errors in results.items():
        found[machine].setdefault((name, level), []).append(errors)
    return {
        machine: {key: spread(UM * np.concatenate(errors)) for key, errors in rows.items()}
        for machine, rows in found.items()
    }


def by_effect(rows):
    """Return (`Constant`, {level: `Spread`}) of one machine's `sensitivity`, the largest change of the mean first."""
    shipped = rows['shipped', ''].mean
    listed = [(c, {level: rows[c.name, level] for level in LEVELS if (c.name, level) in rows}) for c in CONSTANTS]
    return sorted(listed, key=lambda each: -max(abs(found.mean - shipped) for found in each[1].values()))


def sensitivity_report(found, seeds, cycles):
    """Return ([`Table`], figures as a nested dict) of `sensitivity`."""
    tables = []
    for machine, rows in found.items():
        shipped = rows['shipped', '']
        title = (
            f'{MACHINES[machine]}, best law, {ENVIRONMENT}, worst axis by the encoders: {shipped.mean:.2f} '
            f'({shipped.p95:.2f}) um as shipped; mean (95 %) of {seeds} noise seeds x {cycles} cycles'
        )
        cells = [
            [constant.name, *(cell for level in LEVELS for cell in (constant.text(level), _cell(levels.get(level))))]
            for constant, levels in by_effect(rows)
        ]
        tables.append(Table(title, ['constant', 'low', '[um]', 'high', '[um]'], cells))
    data = {
        machine: {
            f'{name} {level}'.strip(): {'mean_um': each.mean, 'p95_um': each.p95}
            for (name, level), each in rows.items()
        }
        for machine, rows in found.items()
    }
    return tables, {'experiment': 'sensitivity', 'seeds': seeds, 'cycles': cycles, **data}


def _cell(found):
    return f'{found.mean:.2f} ({found.p95:.2f})' if found else ''
