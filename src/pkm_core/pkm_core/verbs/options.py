"""Options that several verbs share: one name, one meaning and one help text each; and helpers for their values."""

import math
from datetime import datetime
from pathlib import Path
from shutil import rmtree
from typing import Annotated, Literal

import typer

from pkm_core.arrangement import Arrangement
from pkm_core.config import Configuration
from pkm_core.errors import ConfigError, PkmError
from pkm_core.files import writable_file, writable_folder, write_json
from pkm_core.verbs.completion import environments, machines_with_models, names_of


def finite(value):
    """Refuse an option, one number or several, that is not finite; a callback for typer."""
    if value is not None and not all(map(math.isfinite, value if isinstance(value, tuple) else (value,))):
        raise typer.BadParameter(f'{value} given; expected finite numbers')
    return value


def positive(value):
    """Refuse an option that is not a positive, finite number; a callback for typer."""
    if value is not None and not 0 < value < math.inf:
        raise typer.BadParameter(f'{value} given; expected a positive, finite number')
    return value


def file_option(ctx: typer.Context, path: Path | None):
    """Refuse a file to be written that cannot be, or that exists, before anything runs; a callback for typer."""
    if path is not None and writable_file(path).exists() and not ctx.params.get('overwrite'):
        raise PkmError(f'{path}: exists; {REPLACE}')
    return path


def folder_option(ctx: typer.Context, path: Path | None):
    """Refuse a folder for results that has files, before anything runs; a callback for typer."""
    if path is not None and not ctx.params.get('overwrite'):
        require_empty(path)
    return path


def require_empty(path):
    """Raise `PkmError` if the folder `path` has files: those of another run are not replaced unasked."""
    if Path(path).is_dir() and any(Path(path).iterdir()):
        raise PkmError(f'--out: {path} has files; {REPLACE}')


REPLACE = 'expected a new name. With --overwrite the files of the earlier run are replaced'


def _laws():
    """Return the names of the learning laws for a help text."""
    try:
        return ', '.join(Configuration.of_environment().names('learning'))
    except ConfigError:  # help is printed without a configuration too; a verb that needs one reports it
        return 'a name of config/learning'


LAWS = f'Learning law: {_laws()}'

CONTROLLERS = names_of(
    'control', 'control/computed_torque', 'control/observer', more=('robust', 'observer', 'computed_torque')
)

MachineOption = Annotated[
    str,
    typer.Option('--machine', autocompletion=machines_with_models, help='Machine of config/machines, or a YAML file.'),
]
MotionOption = Annotated[
    str,
    typer.Option(
        autocompletion=names_of('motions'), help="Motion of config/motions, or a YAML file; '' is the machine's own."
    ),
]
ControllerOption = Annotated[
    str,
    typer.Option(
        autocompletion=CONTROLLERS,
        help="Gains: robust, observer or computed_torque (the machine's own), a file of config, or a YAML file.",
    ),
]
LawOption = Annotated[str, typer.Option(autocompletion=names_of('learning'), help=f'{LAWS}; or a YAML file.')]
LearningTargetOption = Annotated[
    Literal['joints', 'tool'],
    typer.Option(help='tool: beside the joints, the reference is learned from the laser at the tool.'),
]
TuningOption = Annotated[
    str, typer.Option(autocompletion=names_of('tuning'), help='Targets and limits of config/tuning, or a YAML file.')
]
TolerancesOption = Annotated[
    str, typer.Option(autocompletion=names_of('design'), help='Tolerances of config/design, or a YAML file.')
]
EnvironmentOption = Annotated[
    str,
    typer.Option(
        autocompletion=environments,
        help='Level of imperfections of the simulated machine: ideal, nominal, hard, geometric, warm and flexible '
        '(not xy_stage), elastic (four_dof only), or another section of config/truth.',
    ),
]
SeedOption = Annotated[int, typer.Option(min=0, help='Seed of the random numbers; the same seed gives the same bits.')]
CyclesOption = Annotated[int, typer.Option(min=1, help='Number of learning cycles.')]
JointsOption = Annotated[list[str] | None, typer.Option(help='Axis to identify, repeatable; default: all.')]
ModesOption = Annotated[
    int | None,
    typer.Option(min=1, max=5, help='Number of resonances to fit; default: as in config/model, 2 for a foreign axis.'),
]
NamespaceOption = Annotated[str, typer.Option(help='ROS namespace of the cell.')]
PaceOption = Annotated[
    float,
    typer.Option(help='Simulated time per wall time: 1 is real time, 0.01 to 1000; 0: as fast as possible.'),
]
ProcessesOption = Annotated[int, typer.Option(min=0, help='Number of worker processes; 0: one per processor core.')]
ClusterOption = Annotated[
    str,
    typer.Option(help='Address of a dask scheduler, e.g. tcp://host:8786; its workers replace the local processes.'),
]
ArrangementOption = Annotated[
    Arrangement, typer.Option(help='Simulation without ROS, or the ROS graph in one process or one process per node.')
]
CellArrangementOption = Annotated[
    Literal[Arrangement.composed, Arrangement.processes],
    typer.Option(help='ROS graph in one process, or one process per node.'),
]
OutOption = Annotated[
    Path | None, typer.Option(callback=folder_option, help='Folder for figures and files; default: none are written.')
]
RunFolderOption = Annotated[
    Path | None, typer.Option(callback=folder_option, help='Folder for the results; default: a new folder in runs/.')
]
# eager: the other options are checked with its value
OverwriteOption = Annotated[
    bool, typer.Option('--overwrite', is_eager=True, help='Replace the files of an earlier run.')
]
JsonOption = Annotated[
    Path | None, typer.Option('--json', callback=file_option, help='Write all figures to this JSON file.')
]


def out_folder(path):
    """Return the folder of `--out`, created if missing, or None if the option was not given."""
    return None if path is None else writable_folder(path)


def run_folder(path, name):
    """
    Return the folder of `--out`, created if missing; by default a new one in runs/ with date, time and `name`.

    A folder with files is here only with `--overwrite`: the results and bags of the earlier run in it are removed.
    """
    folder = writable_folder(path or Path('runs') / f'{datetime.now():%Y%m%dT%H%M%S}_{name}')
    remove_run(folder)
    return folder


def remove_run(folder):
    """Remove what an earlier run wrote into `folder`: bags, which are folders with MCAP files, results and figure."""
    for bag in (folder / 'bags').glob('*/'):
        if any(bag.glob('*.mcap')):
            rmtree(bag)
    for name in ('results.json', 'learning.png'):
        (folder / name).unlink(missing_ok=True)


def write_figures(json_file, figures):
    """Write the nested dict `figures` to the file of `--json`; nothing if the option was not given."""
    if json_file is not None:
        write_json(json_file, figures)


def robust_gains(machine, controller):
    """
    Return {joint: RobustGains} of `--controller` for a verb that works on robust controllers only.

    Raises
    ------
    PkmError
        If the file is refused, or it holds gains of computed torque.

    """
    from pkm_core.control.controllers import choose_control, kind_of

    gains = choose_control(machine, controller)
    if kind_of(gains) != 'robust':
        raise PkmError(f'--controller: {controller!r} is for {kind_of(gains)}; expected gains of robust controllers')
    return gains
