"""Rests of a recorded cycle of this cell as measurements of a calibration."""

import json
from pathlib import Path

from pkm_core.bag.cycle_record import read_cycle
from pkm_core.design.calibration_motion import AVERAGED, windows_of_moves
from pkm_core.design.rests import rests_from_arrays
from pkm_core.errors import PkmError
from pkm_core.machines.identity import Specimen


def rests_from_bag(bag, machine, laser, *, namespace=None, averaged=AVERAGED):
    """
    Return the averaged `Measurements` of the rests in a bag of this cell: any cycle with a laser.

    The rest after each move counts, except that after the return home. Encoder readings and laser are averaged over the
    last `averaged` [s] of a rest, or over the whole rest if it is shorter.

    Parameters
    ----------
    bag : Path
        Folder of the bag.
    machine : Machine
        Of the recorded cell; its drawing or a calibrated machine.
    laser : LaserConfig
        Resolution of the laser, and the error of an encoder.
    namespace : str, optional
        Of the cell; by default that of the only cell in the bag.
    averaged : float
        [s]

    Raises
    ------
    BagError
        If `bag` is no bag of a cell, or ticks are missing.
    PkmError
        If it is of another machine, not complete, or a rest is refused (`rests_from_arrays`); the bag is named.

    """
    record, name = read_cycle(bag, namespace), Path(bag).name
    if record.joints != machine.joints or record.coordinates != machine.coordinates:
        raise PkmError(f'{name}: of a machine with joints {list(record.joints)}; expected those of {machine.name}, '
                       f'{list(machine.joints)}')  # fmt: skip
    if not record.is_whole:
        raise PkmError(f'{name}: holds {len(record.ticks)} of {record.samples} ticks; expected a complete cycle')
    windows = record.sample_time * windows_of_moves(record.move_starts, record.move_ends, averaged / record.sample_time)
    time = record.sample_time * (record.ticks - record.ticks[0])
    try:
        return rests_from_arrays(
            machine,
            time,
            record.position,
            record.laser_time,
            record.laser,
            windows,
            laser,
            specimen_of(record, machine),
        )
    except PkmError as error:
        raise PkmError(f'{name}: {error}') from None


def specimen_of(record, machine):
    """
    Return the `Specimen` that a `CycleRecord` was recorded on.

    A simulated machine has recorded its seed and environment; a machine without them is a real one. `PkmError` if the
    bag is of another machine than `machine`.
    """
    recorded = Path(record.facts.get('machine', machine.name)).stem
    if recorded != machine.name:
        raise PkmError(f'recorded on {recorded}; expected {machine.name}')
    node = (json.loads(record.facts.get('parameters') or '{}') or {}).get('machine') or {}
    if 'seed' not in node or 'environment' not in node:
        return Specimen.measured(machine.name)
    return Specimen.simulated(machine.name, node['seed'], node['environment'])
