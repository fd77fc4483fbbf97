"""
Laser measurements at rest: encoder readings and end-point displacements from one unknown datum.

A file of measurements is CSV: lines that begin with `#` name the specimen and the deviation of averaged readings, a
heading has the units, and each row is one pose. A file without a specimen is of a real machine.
"""

import csv
import itertools
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from pkm_core.config import Config, find_config, load_config
from pkm_core.design.specimen import LINKS, OFFSETS, end_point, error_names
from pkm_core.errors import ConfigError, PkmError, WorkspaceError
from pkm_core.machines.base import NotNegativeLength, PositiveLength
from pkm_core.machines.checks import ANGLES
from pkm_core.machines.identity import Specimen


class LaserConfig(Config):
    """Errors of one measurement by the laser: model of config/design/laser.yaml."""

    resolution: NotNegativeLength
    noise: Annotated[NotNegativeLength, Field(description='standard deviation of one reading')]
    rotation_arm: Annotated[PositiveLength, Field(description='displacement per rotation [m/rad]')]
    encoder_error: Annotated[
        NotNegativeLength,
        Field(description='standard deviation of an encoder at rest, which averaging does not reduce'),
    ]

    def scale(self, machine):
        """Return the factors (m,) from a laser length to the coordinates of `machine`."""
        return np.array([1.0 / self.rotation_arm if name in ANGLES else 1.0 for name in machine.coordinates])

    def deviation(self, machine, q):
        """Return the standard deviation (m,) of one measurement at `q` (N, n): laser noise and both roundings."""
        laser = self.scale(machine) ** 2 * (self.noise**2 + self.resolution**2 / 12.0)
        encoders = machine.encoder_resolution**2 / 12.0 + self.encoder_error**2
        return np.sqrt(laser + encoders * encoder_gains(machine, q))


def encoder_gains(machine, q):
    """Return the mean over `q` (N, n) of the squared gain (m,) from errors of single encoders to the end point."""
    return np.sum(machine.jacobian(q) ** 2, axis=-1).mean(axis=0)


class Measurements(NamedTuple):
    """Input of a calibration."""

    q: np.ndarray  # (N, n) encoder readings [m]
    displacement: np.ndarray  # (N, m) of the end point from the datum, in the machine's coordinates [m, rad]
    deviation: np.ndarray | None = None  # (m,) of averaged readings [m, rad]; None: single readings of the laser
    specimen: Specimen | None = None  # that was measured; None: not known

    def rows(self, chosen):
        """Return the measurements of the poses `chosen`, an index of q."""
        return self._replace(q=self.q[chosen], displacement=self.displacement[chosen])

    def noise(self, machine, laser):
        """Return the standard deviation (m,) of one row: as averaged, or that of single readings of `laser`."""
        return laser.deviation(machine, self.q) if self.deviation is None else self.deviation

    def split(self, every=4):
        """Return (used, held out); every fourth pose is held out for validation."""
        held = np.arange(len(self.q)) % every == every - 1
        return self.rows(~held), self.rows(held)


def load_laser(name_or_path='laser') -> LaserConfig:
    """Return the `LaserConfig` of config/design/NAME.yaml or of a path; raise `ConfigError` if it is invalid."""
    return load_config(find_config('design', name_or_path), LaserConfig)


def draw_specimen(machine, tolerances, seed):
    """Return {name: error} [m] of the links, offsets and encoders of one machine built to `tolerances`."""
    error_names(machine)  # refuses machines without links
    draw, mechanism = np.random.default_rng(seed), machine.config.mechanism
    return {
        name: float(spread.draw(draw, None))
        for spread, names in (
            (tolerances.links, LINKS[mechanism]),
            (tolerances.offsets, OFFSETS[mechanism]),
            (tolerances.encoder_offsets, machine.joints),
        )
        for name in names
    }


def simulate(machine, errors, laser, q, seed):
    """
    Return the `Measurements` of a specimen with `errors` at the commanded joint positions `q` (N, n) [m].

    The true position of a slider is uniform within the encoder count read; the datum is the end point at the first
    pose.
    """
    draw = np.random.default_rng(seed)
    step = machine.encoder_resolution
    reading = step * np.round(np.asarray(q) / step)
    standing = reading + step * draw.uniform(-0.5, 0.5, reading.shape)
    pose = end_point(machine, standing, errors)
    scale = laser.scale(machine)
    displacement = pose - pose[0] + laser.noise * scale * draw.standard_normal(pose.shape)
    if laser.resolution > 0.0:
        displacement = laser.resolution * scale * np.round(displacement / (laser.resolution * scale))
    return Measurements(reading, displacement)


_SPECIMEN, _DEVIATION = '# specimen: ', '# deviation: '


def _columns(machine):
    """Return [(heading, factor to SI)] of a file of measurements."""
    lengths = [(f'{name}_urad' if name in ANGLES else f'{name}_um', 1e-6) for name in machine.coordinates]
    return [*((f'{name}_mm', 1e-3) for name in machine.joints), *lengths]


def write_measurements(path, machine, measurements):
    """Write `measurements` to the CSV file `path`: a heading with units, then one row per pose."""
    columns = _columns(machine)
    factors = np.array([factor for _, factor in columns])
    rows = np.hstack([measurements.q, measurements.displacement]) / factors
    with path.open('w', newline='', encoding='utf-8') as file:
        if measurements.specimen is not None:
            file.write(f'{_SPECIMEN}{measurements.specimen}\n')
        if measurements.deviation is not None:
            values = measurements.deviation / factors[len(machine.joints) :]
            file.write(_DEVIATION + ', '.join(f'{value:.6f}' for value in values) + '\n')
        writer = csv.writer(file)
        writer.writerow(heading for heading, _ in columns)
        writer.writerows([f'{value:.6f}' for value in row] for row in rows)


def read_measurements(path, machine):
    """
    Return the `Measurements` of the CSV file `path` in the format of `write_measurements`.

    Raises
    ------
    PkmError
        If the file cannot be read, its heading differs, a cell is not a finite number, or the specimen is one of
        another machine; the message has file, line and cell.

    """
    columns = _columns(machine)
    headings = [heading for heading, _ in columns]
    try:
        with open(path, newline='', encoding='utf-8') as file:
            lines = list(csv.reader(file))
    except (OSError, UnicodeDecodeError) as error:
        raise PkmError(f'{path}: cannot be read: {getattr(error, "strerror", None) or error}') from None
    remarks = [','.join(line) for line in itertools.takewhile(lambda line: line and line[0].startswith('#'), lines)]
    lines = lines[len(remarks) :]
    if not lines or [cell.strip() for cell in lines[0]] != headings:
        raise PkmError(f'{path}: heading {",".join(lines[0]) if lines else ""!r}; expected {",".join(headings)}')
    rows = []
    for number, line in enumerate(lines[1:], start=2 + len(remarks)):
        if len(line) != len(headings):
            raise PkmError(f'{path}: line {number} has {len(line)} cells; expected {len(headings)}')
        for heading, cell in zip(headings, line, strict=True):
            try:
                finite = np.isfinite(float(cell))
            except ValueError:
                finite = False
            if not finite:
                raise PkmError(f'{path}: line {number}: {heading} = {cell!r}; expected a finite number')
        rows.append([float(cell) for cell in line])
    values = np.array(rows).reshape(-1, len(headings)) * [factor for _, factor in columns]
    n = len(machine.joints)
    try:
        machine.check_joints(values[:, :n])
    except WorkspaceError as error:
        raise PkmError(f'{path}: rows counted from 0 below the heading: {error}') from None
    return Measurements(values[:, :n], values[:, n:], *_remarks(path, machine, remarks, columns[n:]))


def _remarks(path, machine, remarks, columns):
    """Return deviation and specimen of the lines `remarks` of a file of measurements; unknown lines are comments."""
    deviation, specimen = None, Specimen.measured(machine.name)
    for number, line in enumerate(remarks, start=1):
        try:
            if line.startswith(_SPECIMEN):
                specimen = Specimen.parse(line.removeprefix(_SPECIMEN))
            elif line.startswith(_DEVIATION):
                values = [float(value) for value in line.removeprefix(_DEVIATION).split(',')]
                if len(values) != len(columns):
                    raise ValueError(f'{len(values)} deviations; expected {len(columns)}')
                deviation = np.array([v * factor for v, (_, factor) in zip(values, columns, strict=True)])
        except (ConfigError, ValueError) as error:
            raise PkmError(f'{path}: line {number}: {error}') from None
    if deviation is not None and not (np.isfinite(deviation).all() and (deviation > 0.0).all()):
        raise PkmError(f'{path}: deviation {deviation.tolist()} (SI); allowed above 0')
    if specimen.machine != machine.name:
        raise PkmError(f'{path}: measured is {specimen}; expected a specimen of {machine.name}')
    return deviation, specimen
