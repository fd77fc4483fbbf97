"""
Models of axes out of the bags of their experiments: functions a process of its own can run.

That process imports what they need; who only submits them, as a node does, starts without scipy.
"""

import numpy as np

from pkm_core.files import writable_folder, write_json
from pkm_core.machines import load_machine


def fit_records(system, joint, records, models, control, band, folder):
    """Return the `AxisIdentification` of a joint from `JointRecord` objects, its pictures drawn into `folder`."""
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.identify import identify_joint

    found = identify_joint(system, joint, records, models, control, band=band)
    draw_identification(writable_folder(folder), system, {joint: found})
    return found


def fit_bags(machine, joint, bags, namespace, models, control, band, folder):
    """
    Return (AxisIdentification, warnings) of a joint from bags of its experiments.

    Parameters
    ----------
    machine : str
        Name or file of the machine.
    joint : str
        Which of its joints.
    bags : list of Path
        Slow moves and sweeps of that joint.
    namespace : str
        Of the cell that was recorded.
    models, control : dict of str to AxisModel, dict of str to RobustGains
        What was believed of the axes and what ran meanwhile.
    band : (float, float)
        [Hz] of the sweep.
    folder : Path
        For its pictures.

    Raises
    ------
    PkmError
        If a bag cannot be read, a fit refuses its data, or the folder cannot be written.

    """
    from pkm_core.identification.bag_data import read_cell_bag

    system = load_machine(machine)
    records, warnings = [], []
    for bag in bags:
        record, notes = read_cell_bag(system, bag, namespace)
        records.append(record)
        warnings += notes
    found = fit_records(system, joint, records, models, control, band, folder)
    return found, [*warnings, *found.warnings]


def write_results(folder, machine, found, models, origin):
    """
    Write {joint: AxisIdentification} into `folder`, which exists: identification.json and the model file.

    Returns the path of the model file, or None if a joint was not swept: a file without its resonances would make
    controllers believe it has none. Arguments are those of `write_model`, but for the name of the machine.
    """
    from pkm_core.identification.model_file import write_model
    from pkm_core.identification.summary import as_figures

    system = load_machine(machine)
    write_json(folder / 'identification.json', {'machine': system.name, 'axes': as_figures(found)})
    if any(axis.high is None for axis in found.values()):
        return None
    path = folder / 'model.yaml'
    write_model(path, system, found, models, origin)
    return path


def typical_coherence(found):
    """Return the median coherence over the lines of the worst response of an `AxisIdentification`, nan without one."""
    return float(min((np.median(response.coherence) for response in found.responses), default=np.nan))
