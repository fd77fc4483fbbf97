"""
Fits of axis models from records or bags, for use in a worker process.

The imports are inside the functions: a node that only submits a fit starts without scipy.
"""

import numpy as np

from pkm_core.files import writable_folder, write_json
from pkm_core.machines import load_machine


def fit_records(machine, joint, records, models, gains, band, folder):
    """Return the `AxisIdentification` of a joint from `JointRecord` objects; write its figures into `folder`."""
    from pkm_core.identification.figures import draw_identification
    from pkm_core.identification.identify import identify_joint

    found = identify_joint(machine, joint, records, models, gains, band=band)
    draw_identification(writable_folder(folder), machine, {joint: found})
    return found


def fit_bags(machine_name, joint, bags, namespace, models, gains, band, folder):
    """
    Return (AxisIdentification, warnings) of a joint from the bags of its experiments.

    Parameters
    ----------
    machine_name : str
        Name or file of the machine.
    joint : str
        Name of the joint.
    bags : list of Path
        Slow moves and sweeps of that joint.
    namespace : str
        Namespace of the recorded cell.
    models, gains : dict of str to AxisModel, dict of str to RobustGains
        Models and gains of all joints during the experiments.
    band : (float, float)
        Band of the sweep [Hz].
    folder : Path
        Folder of the figures.

    Raises
    ------
    PkmError
        If a bag cannot be read, a fit refuses its data, or the folder cannot be written.

    """
    from pkm_core.identification.bag_data import read_cell_bag

    machine = load_machine(machine_name)
    records, warnings = [], []
    for bag in bags:
        record, notes = read_cell_bag(machine, bag, namespace)
        records.append(record)
        warnings += notes
    found = fit_records(machine, joint, records, models, gains, band, folder)
    return found, [*warnings, *found.warnings]


def write_results(folder, machine_name, found, models, origin):
    """
    Write identification.json and the model file of {joint: AxisIdentification} into the existing `folder`.

    Returns the path of the model file, or None without a sweep of every joint: controllers would read a file without
    resonances as a rigid axis. `machine_name` is a name or file; the other arguments are those of `write_model`.
    """
    from pkm_core.identification.model_file import write_model
    from pkm_core.identification.summary import as_figures

    machine = load_machine(machine_name)
    write_json(folder / 'identification.json', {'machine': machine.name, 'axes': as_figures(found)})
    if any(axis.high is None for axis in found.values()):
        return None
    path = folder / 'model.yaml'
    write_model(path, machine, found, models, origin)
    return path


def typical_coherence(found):
    """Return the lowest median coherence of the responses of an `AxisIdentification`; nan without a response."""
    return float(min((np.median(response.coherence) for response in found.responses), default=np.nan))
