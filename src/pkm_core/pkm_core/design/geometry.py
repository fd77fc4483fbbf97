"""Errors of guides, scales and laser axes in design tools: their names and tolerances, and what the laser reads."""

from pkm_core.config import parse_config
from pkm_core.errors import PkmError
from pkm_core.machines.real_geometry import MODELS, laser_axes


def geometry_names(machine):
    """Return the names of all errors beyond lengths and marks, see machines/real_geometry.py."""
    model = MODELS.get(machine.config.mechanism)
    return () if model is None else tuple(model.model_fields)


def geometry_spread(name, tolerances):
    """
    Return (Spread, factor) of the error `name`: its tolerance in `tolerances.geometry`, and its share of it.

    A guide whose wave k has the deviation s / k^2 in cosine and sine has 3 s / k in the Legendre polynomial of degree
    k, within 15 %.

    Raises
    ------
    PkmError
        If the tolerances have no section `geometry`.

    """
    spreads = tolerances.geometry
    if spreads is None:
        raise PkmError('tolerances: no section geometry; expected the spreads of scale, square, tilt, ...')
    kind = name.split('_')[0]
    if kind in ('x', 'y'):
        return spreads.straightness, 3.0 / int(name.split('_')[2])
    named = {'scale': spreads.scale, 'laser': spreads.laser_axes, 'pitch': spreads.tilt, 'roll': spreads.tilt}
    return named[kind] if kind in named else getattr(spreads, kind), 1.0


def geometry_priors(machine, tolerances):
    """Return {name: standard deviation} [m, rad, m/m] of all errors of `geometry_names`."""
    found = {name: geometry_spread(name, tolerances) for name in geometry_names(machine)}
    return {name: factor * spread.deviation for name, (spread, factor) in found.items()}


def read_by_laser(machine, pose, errors):
    """Return `pose` (..., m) along the axes of a laser with the `errors` named laser_xy ...; unchanged without them."""
    named = {name: error for name, error in errors.items() if name.startswith('laser_')}
    if not named:
        return pose
    return (laser_axes(machine.coordinates, named) @ pose[..., None])[..., 0]


def built_geometry(machine, errors):
    """
    Return the `geometry` of a section `built` with the `errors` of `geometry_names`; None if there are none.

    Raises
    ------
    PkmError
        If an error is larger than a machine file may have.

    """
    named = {name: errors[name] for name in geometry_names(machine) if name in errors}
    if not named:
        return None
    return parse_config(named, MODELS[machine.config.mechanism], where='calibration: geometry', context=None)
