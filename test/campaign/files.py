"""Attacks by files: mutated YAML of every kind and damaged bags, read as nodes and verbs read them."""

import shutil
from collections import deque
from contextlib import suppress
from pathlib import Path

from campaign.attacks import FellShortError, attack
from campaign.guarded import outcome_of
from campaign.world import RUN
from pkm_core.bag.cycle_record import read_cycle
from pkm_core.bag.reader import raw_messages
from pkm_core.bag.repair import lost_messages, repair
from pkm_core.bag.signals import Signal
from pkm_core.config import Configuration
from pkm_core.control.controllers import choose_control, make_controller
from pkm_core.control.model import load_model
from pkm_core.design.measurement import load_laser
from pkm_core.design.operational_workspace import load_operational_workspace
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import PkmError
from pkm_core.identification.bag_data import read_axis, read_cell_bag
from pkm_core.learning import make_law
from pkm_core.machines import load_machine
from pkm_core.motion.planning import load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.plant.plant import Plant
from pkm_core.reporting.runs import read_run
from pkm_core.tuning.config import load_tuning

CONFIG = Path(__file__).resolve().parents[2] / 'config'
_VALUES = [
    '', '~', 'no', '1,5 mm', '010 mm', '-1 mm', '.nan', '.inf', '1e400 mm', '5 parsec', '[]', '{}', '[1, 2', '!!int x',
    '!!python/object/apply:os.system [ls]', '2001-99-99', '0x10', '1:30', '9' * 5000, '*a', '&a [*a]', '"\\x00"',
    '1 m @ 2', '5 +- 1 mm', '- - - - -', '"' + 'x' * 5000 + '"', '../../etc/passwd', '0', '1e-300 m', '1000 km',
    '[' * 500,
]  # fmt: skip
_BAG: list = []


def mutated(draw, text):
    """Return the YAML `text` with one to three mutations: values, keys, order, indentation, bytes."""
    lines = text.splitlines() or ['']
    for _ in range(draw.randint(1, 3)):
        at = draw.randrange(len(lines))
        key, colon, _ = lines[at].partition(':')
        way = draw.randrange(7)
        if way <= 2 and colon:
            lines[at] = f'{key}: {draw.choice(_VALUES)}'
        elif way == 3:
            del lines[at]
        elif way == 4:
            lines.insert(at, draw.choice(lines))
        elif way == 5:
            lines[at] = ' ' * draw.randrange(6) + lines[at].strip()
        elif lines[at]:
            where = draw.randrange(len(lines[at]))
            lines[at] = (
                lines[at][:where] + chr(draw.choice([0, 9, 45, 58, 91, 123, 0x85, 0xFFFE])) + lines[at][where + 1 :]
            )
        lines = lines or ['']
    return '\n'.join(lines) + '\n'


def _load_all(folder, relative):
    """Load the file `relative` of the configuration `folder` as the nodes and verbs do."""

    kind, name = relative.parts[0], relative.stem
    configuration, path = Configuration(folder), folder / relative
    if kind == 'design':
        {'laser': load_laser, 'tolerances': load_tolerances, 'chapter4': load_operational_workspace}[name](path)
        return
    if kind == 'tuning':
        load_tuning(path)
        return
    owner = next((each for each in ('planar', 'xy_stage', 'four_dof') if name.startswith(each)), 'four_dof')
    machine = load_machine(owner, configuration)
    if kind == 'motions':
        to_joints(machine, plan(machine, load_motion(path)))
    elif kind == 'learning':
        make_law(name, machine, choose_control(machine))
    elif kind == 'control':
        make_controller(machine, choose_control(machine, str(path)))
    elif kind == 'truth':
        Plant(machine, 1, 'nominal')
    else:
        load_model(machine)


@attack('files', share=50, cases=sorted(path.relative_to(CONFIG) for path in CONFIG.rglob('*.yaml')))
def mutated_configuration(world, draw, relative):
    """A mutated file is accepted or refused in one line, within limits of time and memory."""
    folder = world.folder / 'config'
    shutil.copytree(CONFIG, folder)
    text = mutated(draw, (CONFIG / relative).read_text(encoding='utf-8'))
    (folder / relative).write_text(text, encoding='utf-8', errors='surrogatepass')
    if outcome := outcome_of(lambda: _load_all(folder, relative), folder):
        raise FellShortError(f'{relative}: {outcome}')
    return str(relative)


def _whole_bag(world):
    """Return {file: bytes} of a bag of one short run, recorded once."""
    if not _BAG:
        client = world.pkm('run', '--cycles', 1, '--out', world.folder / 'recorded', log='recorded')
        if world.code_of(client, RUN, 'a run of one cycle'):
            raise FellShortError(f'a run of one cycle fails: {world.tail("recorded")}')
        bag = next((world.folder / 'recorded' / 'bags').iterdir())
        _BAG.append({path.name: path.read_bytes() for path in bag.iterdir() if path.is_file()})
    return _BAG[0]


def _damage(draw, folder):
    """Damage one file of the bag `folder`; return what was done."""
    path = draw.choice(sorted(folder.iterdir()))
    data, way = bytearray(path.read_bytes()), draw.choice(['cut', 'flip', 'lengths', 'zeros', 'text', 'empty', 'gone'])
    if way == 'cut':
        del data[draw.randrange(len(data)) :]
    elif way == 'flip':
        for _ in range(draw.choice([1, 1, 100])):
            data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
    elif way == 'lengths':
        at = draw.randrange(max(1, len(data) - 8))
        data[at : at + 8] = draw.choice([b'\xff' * 8, b'\xff\xff\xff\x7f' + bytes(4), bytes(8)])
    elif way == 'zeros':
        at = draw.randrange(len(data))
        data[at : at + 200] = bytes(min(200, len(data) - at))
    elif way == 'text':
        data = (
            bytearray(mutated(draw, data.decode(errors='replace')), 'utf-8') if path.suffix == '.yaml' else data[::-1]
        )
    elif way == 'empty':
        data.clear()
    path.unlink()
    if way != 'gone':
        path.write_bytes(data)
    return f'{way} of {path.name}'


def _read_all(folder):
    """Read the bag as report, doctor, identification, replay and `ros2 bag info` do."""

    from pkm_nodes.ros2.bag import read_folder, read_mcap

    drive, sensor = Signal('/pkm/d1/command', 'voltage'), Signal('/pkm/d1/encoder', 'position')
    tried = [
        lambda: read_run(folder.parent),
        lambda: read_cell_bag(load_machine('four_dof'), folder),
        lambda: read_axis(folder, drive, sensor),  # as a bag of a foreign axis
        lambda: read_cycle(folder),
        lambda: deque(raw_messages(folder), maxlen=0),  # bag-play and page
        lambda: lost_messages(folder),
        lambda: repair(folder),
    ]
    for each in tried:
        with suppress(PkmError):
            each()
    with suppress(RuntimeError):  # the refusal of `ros2 bag info`
        read_folder(folder)
    for file in folder.glob('*.mcap'):
        with suppress(RuntimeError):
            read_mcap(file)


@attack('files', share=50)
def damaged_bag(world, draw):
    """A damaged bag is read, repaired or refused in one line, within limits of time and memory."""
    folder = world.folder / 'bags' / 'bag'
    folder.mkdir(parents=True)
    for name, data in _whole_bag(world).items():
        (folder / name).write_bytes(data)
    what = _damage(draw, folder)
    if outcome := outcome_of(lambda: _read_all(folder), folder):
        raise FellShortError(f'{what}: {outcome}')
    return what
