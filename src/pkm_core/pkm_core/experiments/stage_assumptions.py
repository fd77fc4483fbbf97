"""
The XY stage under other assumptions than the shipped ones: friction, first mode, moved mass, move time, tuning rules.

The thesis gives its moved masses, its peak current and one resonance. Everything else is chosen. Truth and model of the
controllers change together: the stage is well identified under every assumption. The feedback is tuned for each first
mode as `pkm tune` does it, with the same budget.
"""

import shutil
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

from pkm_core.config import Configuration, parse_config, read_yaml
from pkm_core.control.model import load_model
from pkm_core.control.robust import RobustGains
from pkm_core.experiments.condition import Prepared
from pkm_core.machines import load_machine
from pkm_core.motion.planning import Motion, default_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.tuning.config import load_tuning
from pkm_core.tuning.problem import TuningProblem
from pkm_core.tuning.recommend import recommended
from pkm_core.tuning.search import new_branches, run_search

STAGE = 'xy_stage'
ENVIRONMENT = 'exact'  # no link errors: what remains at the end point is due to control
SEED = 1  # of the search, as for the shipped gains
WEAK_INTEGRAL = 0.8  # [Hz] KI/KP/(2 pi): 5 1/s, as the loops of config/control/planar_thesis.yaml


@dataclass(frozen=True)
class Assumptions:
    """Assumptions about the stage; the defaults are the shipped ones. The first mode is that of the X axis."""

    friction: float = 2.0  # [N] Coulomb force of each guide
    mode: float = 220.0  # [Hz]; that of y keeps its ratio to it
    damping: float = 1.0  # factor of all dampings of the modes
    masses: tuple[float, float] = (8.2, 3.0)  # [kg]; that of x includes y
    move_time: float = 100e-3  # [s]
    move: tuple[float, float] = (10e-3, 10e-3)  # [m]
    weak_integral: bool = False  # the search is restricted to the integral action of the thesis's loops

    @property
    def loop(self):
        """The assumptions on which the search for gains depends."""
        return self.mode, self.damping, self.weak_integral


SHIPPED = Assumptions()


def tuned(loop, executor, on_generations=lambda done: None):
    """
    Return the gains of an axis with thrust gain 1 m/s^2/V, as a dict, for `Assumptions.loop`.

    Budget, objective and limits are those of config/tuning. Below the shipped mode the frequencies in it fall with the
    mode: target bandwidth, the frequency from which |L| counts as a resonance, and the lower ends of the search range.
    The search does not depend on the thrust gain, and both axes have the same model: one search serves both.
    """
    machine = load_machine(STAGE)
    problem = TuningProblem(tuning_rules(loop), axis_model(machine, 'x', loop), machine.sample_time)
    branches = new_branches({'x': problem})

    def on_progress(found):
        on_generations(sum(branch.generations for branch in found))

    run_search({'x': problem}, branches, SEED, executor, save=lambda found: None, on_progress=on_progress)
    gains = recommended(problem, branches)[0]
    return scaled(gains.model_dump(), problem.model.gain)


def scaled(gains, factor):
    """Return the dict `gains` with kp, ki, kd times `factor`."""
    return gains | {name: gains[name] * factor for name in ('kp', 'ki', 'kd')}


def axis_model(machine, joint, loop):
    """Return the `AxisModel` of an axis of the stage with the modes of `Assumptions.loop`."""
    mode, damping, _ = loop
    shipped = load_model(machine)[joint]
    return shipped.model_copy(
        update={'modes': tuple(_moved(each, mode / SHIPPED.mode, damping) for each in shipped.modes)}
    )


def _moved(mode, stretch, damping):
    factors = {'resonance': stretch, 'antiresonance': stretch}
    factors |= {'resonance_damping': damping, 'antiresonance_damping': damping}
    return mode.model_copy(update={name: factor * getattr(mode, name) for name, factor in factors.items()})


def tuning_rules(loop):
    """Return the `TuningConfig` of a search for `Assumptions.loop`."""
    mode, _, weak_integral = loop
    config, share = load_tuning(), min(1.0, mode / SHIPPED.mode)
    ranges = {
        name: (share * getattr(config.bounds, name)[0], getattr(config.bounds, name)[1])
        for name in ('speed_crossover', 'derivative_zero', 'integral_zero', 'lag_pole', 'notch_centre', 'notch_width')
    }
    if weak_integral:
        ranges['integral_zero'] = (0.5 * WEAK_INTEGRAL, WEAK_INTEGRAL)
    targets, limits = config.targets, config.limits
    return config.model_copy(
        update={
            'targets': targets.model_copy(update={'bandwidth': share * targets.bandwidth}),
            'limits': limits.model_copy(update={'resonances_from': share * limits.resonances_from}),
            'bounds': config.bounds.model_copy(update=ranges),
        }
    )


@contextmanager
def stage(assumptions, gains):
    """Yield the `Prepared` of the stage under `Assumptions`, with the result of `tuned`; its files are temporary."""
    with tempfile.TemporaryDirectory() as folder:
        copied = Configuration(Path(folder) / 'config')
        shutil.copytree(Configuration.of_environment().folder, copied.folder)
        for kind, change in (('machines', _machine), ('model', _model), ('truth', _truth)):
            path = copied.find(kind, STAGE)
            content = read_yaml(path)
            change(content, assumptions)
            path.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')
        machine = load_machine(STAGE, copied)
        name, models = default_motion(machine), load_model(machine)
        motion = read_yaml(copied.find('motions', name))
        motion['move_time'] = f'{assumptions.move_time} s'
        motion['targets'] = [{'by': {c: f'{by} m' for c, by in zip('xy', assumptions.move, strict=True)}}]
        poses = plan(machine, parse_config(motion, Motion, where=name))
        chosen = {joint: RobustGains(**scaled(gains, 1.0 / models[joint].gain)) for joint in machine.joints}
        yield Prepared(machine, name, poses, to_joints(machine, poses), chosen, None, None)


def _machine(content, assumptions):
    content['masses'] = {name: f'{mass} kg' for name, mass in zip(('mx', 'my'), assumptions.masses, strict=True)}


def _model(content, assumptions):
    for axis, mass, shipped in zip(content['joints'].values(), assumptions.masses, SHIPPED.masses, strict=True):
        axis['gain'] = _times(axis['gain'], shipped / mass)
        _stretch(axis['modes'], assumptions)


def _truth(content, assumptions):
    """Friction changes with the stiffness of the bristles: the presliding distance stays."""
    content['environments'][ENVIRONMENT]['coulomb_friction'] = f'{assumptions.friction} N'
    if assumptions.friction:
        for name in ('stiffness', 'damping'):
            content['friction'][name] = _times(content['friction'][name], assumptions.friction / SHIPPED.friction)
    for axis in content['axes'].values():
        _stretch(axis['modes'], assumptions)


def _stretch(modes, assumptions):
    for mode in modes:
        for name in ('resonance', 'antiresonance'):
            mode[name] = _times(mode[name], assumptions.mode / SHIPPED.mode)
            mode[f'{name}_damping'] = assumptions.damping * float(mode[f'{name}_damping'])


def _times(text, factor):
    """Return a quantity of a file times `factor`, in its unit."""
    number, unit = str(text).split(' ', 1)
    return f'{float(number) * factor!r} {unit}'
