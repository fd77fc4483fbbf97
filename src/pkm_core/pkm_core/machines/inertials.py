"""
Mass properties of the links of pkm_core.machines.description, from the masses and inertias of config/machines.

With them the tree of links has the kinetic energy of `Machine.mass_matrix`. The configuration has one moment of inertia
per link, about the axis on which it turns. The moments that no motion of the mechanism uses are chosen: those of the
visible box, or equal to the given one.
"""

from dataclasses import dataclass

from pkm_core.errors import ConfigError
from pkm_core.machines.description import links


@dataclass(frozen=True)
class Inertial:
    """Mass properties of one link; the axes of the link are its principal axes."""

    mass: float  # [kg]
    centre: tuple[float, float, float]  # of mass, from the link's origin [m]
    moments: tuple[float, float, float]  # about the link's x, y, z through the centre of mass [kg m^2]


def inertials(machine):
    """Return {link: Inertial} of the moving links of `machine`; the frame `tool0` has no mass."""
    try:
        weigh = _MASSES[machine.config.mechanism]
    except KeyError:
        raise ConfigError(f'{machine.name}: mechanism {machine.config.mechanism!r} has no description') from None
    return weigh(machine.config, {link.name: link.boxes[0] for link in links(machine) if link.boxes})


def _box(mass, box, centre=None):
    """Return a solid box of `mass` with the sides of `box`, at its centre or at `centre`."""
    x, y, z = (side * side for side in box.size)
    moments = (mass * (y + z) / 12.0, mass * (x + z) / 12.0, mass * (x + y) / 12.0)
    return Inertial(mass, box.centre if centre is None else centre, moments)


def _bar(mass, box, distance, inertia):
    """Return a bar along x with its centre of mass at `distance`; `inertia` across it, along it that of its box."""
    return Inertial(mass, (distance, 0.0, 0.0), (_box(mass, box).moments[0], inertia, inertia))


def _ball(mass, centre, inertia):
    """Return a link with the same `inertia` about every axis."""
    return Inertial(mass, centre, 3 * (inertia,))


def _planar(config, boxes):
    masses, inertias, geometry = config.masses, config.inertias, config.geometry
    return {
        'slider_d1': _box(masses.m1, boxes['slider_d1']),
        'slider_d3': _box(masses.m3, boxes['slider_d3']),
        'link_2': _bar(masses.m2, boxes['link_2'], geometry.r2, inertias.I2),
        'link_4': _bar(masses.m4, boxes['link_4'], geometry.r4, inertias.I4),
        'platform_p': _box(masses.mp, boxes['platform_p']),
    }


def _four_dof(config, boxes):
    masses, inertias, geometry = config.masses, config.inertias, config.geometry
    found = _planar(config, boxes)
    found |= {
        'slider_d5': _box(masses.m5, boxes['slider_d5']),
        'slider_d7': _box(masses.m7, boxes['slider_d7']),
        'link_6': _bar(masses.m6, boxes['link_6'], geometry.r6, inertias.I6),
        'link_8': _bar(masses.m8, boxes['link_8'], geometry.r8, inertias.I8),
        'platform_q': _box(masses.mq, boxes['platform_q']),
        'link_9': _ball(masses.m9, (0.0, 0.0, 0.0), inertias.I9),
        'link_11': _ball(masses.m11, (0.0, 0.0, 0.0), inertias.I11),
        'end_effector': _ball(masses.mef, (0.0, 0.0, 0.0), inertias.Ief),
    }
    slender = inertias.rods_about_vertical == 'slender'
    for name, mass, distance, inertia in (
        ('link_10', masses.m10, geometry.r10, inertias.I10),
        ('link_12', masses.m12, geometry.r12, inertias.I12),
    ):
        rod = _bar(mass, boxes[name], distance, inertia)
        found[name] = rod if slender else _ball(mass, rod.centre, inertia)
    return found


def _xy_stage(config, boxes):
    masses = config.masses
    carried = _box(masses.my, boxes['table'])
    return {'carriage_x': _box(masses.mx - masses.my, boxes['carriage_x']), 'table': carried}


_MASSES = {'four_dof': _four_dof, 'planar': _planar, 'xy_stage': _xy_stage}
