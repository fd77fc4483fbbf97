"""
Error budget: first-order effect of each source of error on the end point, ranked.

A source is one random number, drawn once per machine or once per pose. Its effect on links, marks and belts is linear.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pkm_core.design.geometry import geometry_names, geometry_spread
from pkm_core.design.specimen import BELTS, LINKS, OFFSETS, error_names, sensitivities
from pkm_core.design.tolerances import LengthSpread
from pkm_core.machines.built import drawn_length


@dataclass(frozen=True)
class Source:
    """
    One independent source of error.

    Attributes
    ----------
    name, group : str
        E.g. 'l2', 'link lengths'.
    spread : Spread
        Distribution of its random number.
    each_pose : bool
        Whether it is drawn once per pose; otherwise once per machine.
    effect : dict
        {name of a specimen's error: error per unit of the source}, numbers or arrays (poses,).

    """

    name: str
    group: str
    spread: Any
    each_pose: bool
    effect: dict[str, Any]


def sources(machine, tolerances, q, geometry=False):
    """
    Return the tuple of all `Source` of `machine` at the joint positions `q` (poses, n) [m].

    With `geometry`, guides and scales are among them; `PkmError` if the tolerances have no such section.
    """
    error_names(machine)  # refuses machines without links
    mechanism, drawn = machine.config.mechanism, machine.config.geometry
    rounding = LengthSpread(uniform=0.5 * machine.encoder_resolution)
    links, offsets = LINKS[mechanism], OFFSETS[mechanism]
    lengths = {link: drawn_length(drawn, link) for link in links}
    lengths |= {offset: getattr(drawn, offset) for offset in offsets}
    thermal, belts = tolerances.thermal, tolerances.belts
    return (
        *(Source(name, 'link lengths', tolerances.links, False, {name: 1.0}) for name in links),
        *(Source(name, 'offsets', tolerances.offsets, False, {name: 1.0}) for name in offsets),
        *(Source(name, 'encoder offsets', tolerances.encoder_offsets, False, {name: 1.0}) for name in machine.joints),
        *(Source(f'{name} rounding', 'encoder resolution', rounding, True, {name: 1.0}) for name in machine.joints),
        *(Source(name, 'belts', belts.torque, True, {name: 1.0 / belts.stiffness}) for name in BELTS[mechanism]),
        Source(
            'links warm',
            'thermal',
            thermal.links_warm,
            False,
            {name: thermal.links_expand * length for name, length in lengths.items()},
        ),
        Source(
            'scales warm',
            'thermal',
            thermal.scales_warm,
            False,
            # a longer scale reads less
            {name: -thermal.scales_expand * q[..., i] for i, name in enumerate(machine.joints)},
        ),
        *(_geometry_sources(machine, tolerances) if geometry else ()),
    )


def _geometry_sources(machine, tolerances):
    """Yield the `Source` of each error of guides and scales; the laser is no source."""
    for name in geometry_names(machine):
        kind = name.split('_')[0]
        if kind != 'laser':
            spread, share = geometry_spread(name, tolerances)
            group = {'scale': 'scales', 'x': 'straightness', 'y': 'straightness'}.get(kind, 'squareness and height')
            yield Source(name, group, spread, False, {name: share})


class LinearBudget(NamedTuple):
    """First-order budget at given poses; the last axis is that of the machine's coordinates [m, rad]."""

    sources: tuple  # of Source
    deviations: np.ndarray  # (sources, poses, m): standard deviation due to each source alone

    def total(self):
        """Return the standard deviation (poses, m) of all sources together."""
        return np.sqrt(np.sum(self.deviations**2, axis=0))

    def shares(self):
        """Return {group: share (m,) of the variance, mean over the poses}, the largest in position first."""
        variances = np.mean(self.deviations**2, axis=1)
        groups = {}
        for source, variance in zip(self.sources, variances, strict=True):
            groups[source.group] = groups.get(source.group, 0.0) + variance
        return dict(_ranked({group: variance / variances.sum(axis=0) for group, variance in groups.items()}))

    def source_deviations(self):
        """Return {name of source: standard deviation (m,), quadratic mean over the poses}, the largest first."""
        means = np.sqrt(np.mean(self.deviations**2, axis=1))
        return dict(_ranked({source.name: mean for source, mean in zip(self.sources, means, strict=True)}))


def _ranked(rows):
    return sorted(rows.items(), key=lambda row: -np.sum(row[1][:3] ** 2))  # by position; phi has another unit


def linear_budget(machine, tolerances, q, geometry=False):
    """
    Return the `LinearBudget` of `machine` at the joint positions `q` (poses, n) [m]; `geometry` as in `sources`.

    Examples
    --------
    >>> from pkm_core.design.tolerances import load_tolerances
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> budget = linear_budget(planar, load_tolerances(), planar.home[np.newaxis])
    >>> (1e6 * budget.total()).round(2)  # um
    array([[16.94, 12.97]])
    >>> list(budget.shares())[0]
    'link lengths'

    """
    q = np.asarray(q, dtype=float)
    all_sources = sources(machine, tolerances, q, geometry)
    return LinearBudget(all_sources, np.abs(_effects(machine, all_sources, q)))


def _effects(machine, all_sources, q):
    """Return the signed effect (sources, poses, m) on the end point of one standard deviation of each source."""
    names = [*error_names(machine)]
    names += sorted({name for source in all_sources for name in source.effect} - set(names))
    S = sensitivities(machine, q, names)
    return np.array(
        [
            source.spread.deviation
            * sum(S[..., names.index(name)] * np.asarray(gain)[..., np.newaxis] for name, gain in source.effect.items())
            for source in all_sources
        ]
    )


def deviation_from_datum(machine, all_sources, q):
    """
    Return the standard deviation (m,) of the end-point error less its mean over the poses `q` (poses, n).

    It is the quadratic mean over the poses, of the sources that are drawn once per machine. A laser from an unknown
    datum measures no more.
    """
    effects = _effects(machine, [source for source in all_sources if not source.each_pose], np.asarray(q, dtype=float))
    return np.sqrt(np.mean(np.sum((effects - effects.mean(axis=1, keepdims=True)) ** 2, axis=0), axis=0))


def clearance_deviations(machine, clearance, q):
    """
    Return (standard deviation, worst case), each (m,) [m, rad], of the end point by play in the joints of the links.

    Each link has a joint at both ends. Each lets the end shift along the link by up to half of `clearance` [m] to
    either side; across the link it has no effect of first order. The deviation is for uniform, independent shifts, the
    quadratic mean over the poses `q` (poses, n); the worst case is that of all shifts at the worst pose.

    Examples
    --------
    >>> from pkm_core.machines import load_machine
    >>> planar = load_machine('planar')
    >>> deviation, worst = clearance_deviations(planar, 100e-6, planar.home[np.newaxis])
    >>> (1e6 * deviation).round(), (1e6 * worst).round()  # um
    (array([67., 32.]), array([233., 111.]))

    """
    error_names(machine)  # refuses machines without links
    S = sensitivities(machine, np.asarray(q, dtype=float), LINKS[machine.config.mechanism])
    deviation = clearance / np.sqrt(12.0) * np.sqrt(2.0 * np.mean(np.sum(S**2, axis=-1), axis=0))
    return deviation, clearance * np.abs(S).sum(axis=-1).max(axis=0)
