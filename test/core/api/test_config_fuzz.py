"""
Seeded fuzz of every kind of configuration file, as simulation and nodes use them.

A mutated file is used or refused in a few short lines. Two thirds of the mutations put an odd value in the place
of another; the others damage the text.
"""

import random
import shutil
from pathlib import Path

import pytest

from pkm_core.config import Configuration
from pkm_core.control.controllers import KINDS as CONTROL
from pkm_core.control.controllers import make_controller
from pkm_core.control.model import load_model
from pkm_core.design.measurement import load_laser
from pkm_core.design.operational_workspace import load_operational_workspace
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import PkmError
from pkm_core.learning import untested_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant
from pkm_core.tuning.config import load_tuning

CONFIG = Configuration.of_environment().folder
LONGEST = 400  # characters of a refusal without the folder of the file
MUTATIONS, SLOW = 100, {'learning': 30, 'truth': 40}  # per file; 400 were tried once
ODD = [
    *('null', '', '0', '-1', '7', '1e300', '.nan', '.inf', 'true', '[]', '{}', '[1, 2]', '{x: 1}', '""', '"\\0"', '~'),
    *('0 mm', '-1 mm', '1e300 mm', '1e-300 mm', '1e12 mm', '5 kg', '1 s', '1e-9 s', '1e6 s', '0.1 s', '3 Hz', '1e9 V'),
    *('1,5 mm', '010 mm', '5 +- 1 mm', '5 degC', 'nan mm', '1e400 mm', '5 mm mm', '５ mm', '1 µm', '50 %', '-200 %'),
    *('2020-99-01', '!!int x', '!!binary "="', '!!python/name:os.system', '*absent', '&a [*a]', '<<', '!!set {a}'),
    *('9' * 5000, 'x' * 5000, '../../etc/passwd', '/dev/zero', 'planar', 'four_dof', 'fourier.py:Law', '[[[[[]]]]]'),
]  # fmt: skip


def odd_value(text, draw):
    lines = text.splitlines()
    number = draw.choice([n for n, line in enumerate(lines) if ':' in line.partition('#')[0]])
    key, _, _ = lines[number].partition(':')
    lines[number] = f'{key}: {draw.choice(ODD)}'
    return '\n'.join(lines)


def odd_inner_value(text, draw):
    """Replace a value within a list or a mapping on one line."""
    lines = text.splitlines()
    inner = [n for n, line in enumerate(lines) if set('[{') & set(line.partition('#')[0])]
    if not inner:
        return odd_value(text, draw)
    number = draw.choice(inner)
    line = lines[number].partition('#')[0]
    ends = [at for at, letter in enumerate(line) if letter in ',]}']
    end = draw.choice(ends) if ends else len(line)
    start = max(line.rfind(mark, 0, end) for mark in '[{,:')
    lines[number] = f'{line[: start + 1]} {draw.choice(ODD)}{line[end:]}'
    return '\n'.join(lines)


def odd_lines(text, draw):
    """Delete, double, move or indent a line."""
    lines = text.splitlines()
    at = draw.randrange(len(lines))
    line = lines.pop(at)
    kind = draw.randrange(4)
    if kind == 1:
        lines[at:at] = [line, line]
    elif kind == 2:
        lines.insert(draw.randrange(len(lines) + 1), line)
    elif kind == 3:
        lines.insert(at, ' ' * draw.randint(1, 3) + line)
    return '\n'.join(lines)


def odd_letters(text, draw):
    """Replace, delete or insert up to three characters, or cut the end."""
    if draw.random() < 0.2:
        return text[: draw.randrange(len(text))]
    for _ in range(draw.randint(1, 3)):
        at = draw.randrange(len(text))
        text = text[:at] + draw.choice(['', *'0-.,: {}[]&*!"\'#\t\n%éx']) + text[at + draw.randrange(2) :]
    return text


KINDS = [odd_value, odd_value, odd_inner_value, odd_inner_value, odd_lines, odd_letters]


def use_machine(config, name):
    machine = load_machine(name, config)
    machine.inverse(machine.forward(machine.home))
    return machine


def use_model(config, name):
    return load_model(load_machine(name, config))


def use_control(config, name, kind='robust'):
    machine = load_machine(name.removesuffix('_thesis'), config)
    folder, load = CONTROL[kind]
    make_controller(machine, load(machine, config.find(folder, name)))


def use_truth(config, name):
    machine = load_machine(name, config)
    for environment in ('nominal', 'hard'):
        Plant(machine, seed=1, environment=environment)


def use_motion(config, name):
    motion = load_motion(name, config)
    machine = load_machine(motion.machine, config)
    to_joints(machine, plan(machine, motion))


def use_law(config, name):
    machine = load_machine('planar', config)
    law = untested_law(name, machine, CONTROL['robust'][1](machine))
    if hasattr(law, 'with_reference'):
        law.with_reference(REFERENCE)


def use_design(config, name):
    loads = {'laser': load_laser, 'tolerances': load_tolerances, 'chapter4': load_operational_workspace}
    loads[name](config.find('design', name))


PLANAR = load_machine('planar')
REFERENCE = to_joints(PLANAR, plan(PLANAR, load_motion('planar_80ms')))
USES = {
    'machines': use_machine,
    'model': use_model,
    'control': use_control,
    'control/computed_torque': lambda config, name: use_control(config, name, 'computed_torque'),
    'control/observer': lambda config, name: use_control(config, name, 'observer'),
    'truth': use_truth,
    'motions': use_motion,
    'learning': use_law,
    'tuning': lambda config, name: load_tuning(config.find('tuning', name)),
    'design': use_design,
}
FILES = [f'{folder}/planar' for folder in ('machines', 'model', 'control', 'control/computed_torque', 'truth')]
FILES += ['motions/planar_80ms', 'motions/planar_limits', 'learning/fourier_pid', 'learning/basis', 'tuning/robust']
FILES += ['control/observer/planar', 'tuning/observer']
FILES += ['design/tolerances', 'design/chapter4']


@pytest.mark.parametrize('file', FILES)
def test_mutated_file_is_used_or_refused_in_short_lines(tmp_path, file):
    shutil.copytree(CONFIG, tmp_path / 'config')
    config, path = Configuration(tmp_path / 'config'), tmp_path / 'config' / f'{file}.yaml'
    text, use = path.read_text(), USES[str(Path(file).parent)]
    use(config, path.stem)
    for seed in range(SLOW.get(file.partition('/')[0], MUTATIONS)):
        draw = random.Random(f'{file} {seed}')
        mutated = KINDS[seed % len(KINDS)](text, draw)
        path.write_text(mutated)
        try:
            use(config, path.stem)
        except PkmError as error:
            if len(str(error).replace(str(path), '')) > LONGEST:
                raise AssertionError(f'seed {seed}: refusal of {len(str(error))} characters') from error
        except Exception as error:
            raise AssertionError(f'seed {seed}: {changed(text, mutated)}') from error


def changed(text, mutated):
    """Return the first line that differs, for the report of a failure."""
    pairs = zip(text.splitlines(), mutated.splitlines(), strict=False)
    return next((f'{old!r} -> {new[:100]!r}' for old, new in pairs if old != new), 'cut')
