"""
The whole physical machine, one servo tick at a time: volts in, encoder counts out.

Signal path: DAC and saturation -> one sample of computation delay and zero-order hold -> current loop -> thrust
-> coupled rigid dynamics with gravity (on links 10, 12 and the end-effector), friction and stops -> flexible modes ->
encoder. The parts are drive.py, machines/dynamics.py (belts.py), friction.py, contact.py, modes.py or flexible.py, and
encoder.py; tick.py composes them.

An extra mass on each carriage reproduces the identified gains K_i and viscosities a_i of (7.34), (8.4):
K_i = thrust_per_volt / (M_ii(home) + extra_i), b_i = a_i (M_ii(home) + extra_i). M_ii is the mass that one axis moves
while the others are held. The extra mass stands for parts that Table 6.1 does not list; the thesis does not explain it.
"""

import copy
import numbers
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from pkm_core.errors import PkmError
from pkm_core.machines.assembly import Assembly
from pkm_core.plant.arrays import QD, REFUSED, Q
from pkm_core.plant.build import build
from pkm_core.plant.drive import phase_currents
from pkm_core.plant.heat import Heat
from pkm_core.plant.noise import CycleNoise
from pkm_core.plant.specimen import assemble
from pkm_core.plant.tick import advance
from pkm_core.plant.truth import Drive, load_truth


@dataclass(frozen=True)
class PlantTruth:
    """
    True state at one instant; for tests, reports and the laser only.

    Attributes
    ----------
    time : float
        Since power-up [s].
    q, qd : ndarray, shape (n,)
        Position and speed of the scales, deflections of the modes included [m], [m/s].
    rigid_q : ndarray, shape (n,)
        Joint positions of the rigid machine [m].
    belts, belt_rates : ndarray, shape (2,) or (0,)
        Rotations psi_p, psi_q of the platforms [rad], [rad/s]; empty if the belts are modelled as stiff.
    current : ndarray, shape (n,)
        Amplitude of the phase currents [A].
    thrust, friction : ndarray, shape (n,)
        On the carriages, friction positive against the motion [N]; means of the last substep.
    assembly : Assembly
        The specimen.
    drive : truth.Drive
        Amplifiers and motors.

    """

    time: float
    q: np.ndarray
    qd: np.ndarray
    rigid_q: np.ndarray
    belts: np.ndarray
    belt_rates: np.ndarray
    current: np.ndarray
    thrust: np.ndarray
    friction: np.ndarray
    assembly: Assembly
    drive: Drive

    @cached_property
    def pose(self):
        """The end point (m,) [m, rad] from true joint positions, link lengths and belt rotations."""
        return self.assembly.end_point(self.q, self.belts)

    @property
    def phase_currents(self):
        """The three phase currents (3, n) [A]."""
        return phase_currents(self.current, self.rigid_q, self.drive.pitch)


class Plant:
    """
    One simulated machine, at home and at rest until the first tick.

    At home the encoders read the home position; the joints are off by the offsets of the reference marks.

    Parameters
    ----------
    machine : Machine
        Nominal design; the truth is read from config/truth/<machine.name>.yaml.
    seed : int
        The same seed gives the same bits of the specimen and of every disturbance.
    environment : str
        A section of that file: 'ideal', 'nominal', 'hard', 'exact', 'geometric', 'warm' and 'flexible' (not xy_stage),
        and for four_dof 'elastic'; see truth.py.
    rise : array_like, optional
        Temperatures at power-up [K] in an environment with heat, see `Heat`; by default those of the room.

    Raises
    ------
    PkmError
        If the seed or `rise` is refused, or `machine` has the calibrated lengths of another specimen.

    """

    def __init__(self, machine, seed, environment='nominal', rise=None):
        if not isinstance(seed, numbers.Integral) or isinstance(seed, bool) or seed < 0:
            raise PkmError(f'plant: seed {seed!r} given; allowed: whole numbers from 0')
        machine.check_specimen(seed, environment)
        self.machine = machine
        truth, levels = load_truth(machine, environment)
        self._drive = truth.drive
        self._assembly = assemble(machine, truth, levels, seed)
        self._built = build(machine, truth, levels, self._assembly)
        self._heat = levels.heat and Heat(machine, truth.drive, levels.heat, self._assembly, rise)
        if rise is not None and not self._heat:
            raise PkmError(f'plant: rise given; the environment {environment!r} of {machine.name} has no section heat')
        self._substeps = round(machine.sample_time / truth.substep)
        directions = [axis.direction for axis in truth.axes.values()]
        self._noise = CycleNoise(seed, levels, directions, truth.vibration_band, machine.sample_time)
        self._no_volts = np.zeros(len(machine.joints))
        self.reset()
        next(self.brake(1))  # numba compiles or loads its cache here, not in the first tick
        self.reset()

    def reset(self):
        """Return to the state at construction: home, at rest, cycle 0, no fault."""
        self._arrays = copy.deepcopy(self._built)
        self._arguments = tuple(getattr(self._arrays, field.name) for field in fields(self._arrays))
        self._ticks = 0
        self._fault = None
        if self._heat:
            self._heat.reset()
        self.start_cycle(0)

    def start_cycle(self, cycle):
        """Draw the disturbances of `cycle` (from 0), and take up the heat since the last one; the motion continues."""
        if not isinstance(cycle, numbers.Integral) or isinstance(cycle, bool) or cycle < 0:
            raise PkmError(f'plant: cycle {cycle!r} given; allowed: whole numbers from 0')
        self._noise.start(int(cycle))
        for name, factor in (('newton_per_ampere', self._noise.gain), ('coulomb', self._noise.friction)):
            self._arrays.parameters[name] = self._built.parameters[name] * factor
        if self._heat:
            self._heat.take_losses(self._arrays.axes, self._ticks)
            self._heat.apply(self._arrays, self._built)
            self._assembly = self._heat.assembly()
        self._index = 0

    def pass_time(self, seconds, *, repeating=False):
        """
        Let `seconds` pass between two cycles; they are not part of the simulated time. Only temperatures change.

        The machine is at rest without losses, or `repeating` the last cycle with its mean losses. `PkmError` if
        `seconds` is negative or not finite.
        """
        if not (np.isfinite(seconds) and seconds >= 0.0):
            raise PkmError(f'plant: {seconds!r} s given; allowed: finite values from 0')
        if self._heat:
            self._heat.take_losses(self._arrays.axes, self._ticks)
            self._heat.pass_time(seconds, *(self._heat.losses if repeating else self._heat.no_losses))

    def tick(self, volts):
        """
        Advance by one sample time and return the new reading.

        Parameters
        ----------
        volts : array_like, shape (n,)
            Command computed from the present reading [V]; the drive applies it, saturated, from the next tick on.

        Returns
        -------
        counts : ndarray of int64, shape (n,)

        Raises
        ------
        PkmError
            If `volts` has another shape or a value that is not finite; the state is unchanged then.

        """
        return self._advance(volts, False)

    def run(self, loop, ticks):
        """
        Advance by at most `ticks` in a compiled loop that ends at a fault; return the number of ticks done.

        `loop(arguments, counts, noise, row, substeps, index, stop)` calls tick.advance for each of `index` to `stop`
        with the next row of the noise. It returns the next index and the event that ended it, or 0.

        Raises
        ------
        PkmError
            If a voltage is not finite.

        """
        index = event = 0
        while index < ticks and event == 0:
            noise, row = self._noise.at(self._index)
            stop = min(ticks, index + noise.shape[1] - row)
            done, event = loop(self._arguments, self._arrays.counts, noise, row, self._substeps, index, stop)
            if event == REFUSED:
                raise PkmError(f'plant {self.machine.name}: tick {done - 1} of the loop: a voltage is not finite')
            self._index += done - index
            self._ticks += done - index
            index = done
        if event and self._fault is None:
            self._fault = self._describe(event - 1)
        return index

    def brake(self, ticks):
        """Yield the reading of each of `ticks` ticks with the motors shorted: a safe stop without a controller."""
        for _ in range(ticks):
            yield self._advance(self._no_volts, True)

    @property
    def counts(self):
        """The present reading, int64 (n,)."""
        return self._arrays.counts.copy()

    @property
    def fault(self):
        """The first fault since `reset` as text, or None; the simulation continues after a fault."""
        return self._fault

    @property
    def temperatures(self):
        """{node: temperature over ambient [K]}, to judge; empty without a section `heat`."""
        return dict(zip(self._heat.nodes, self._heat.rise.tolist(), strict=True)) if self._heat else {}

    @property
    def truth(self):
        """The `PlantTruth` of this instant."""
        axes, motion, n = self._arrays.axes, self._arrays.motion, len(self.machine.joints)
        return PlantTruth(
            time=self._ticks * self.machine.sample_time,
            q=axes['position'].copy(),
            qd=axes['speed'].copy(),
            rigid_q=motion[Q, :n].copy(),
            belts=motion[Q, n:].copy(),
            belt_rates=motion[QD, n:].copy(),
            current=axes['current'].copy(),
            thrust=axes['thrust'].copy(),
            friction=axes['friction'].copy(),
            assembly=self._assembly,
            drive=self._drive,
        )

    def _advance(self, volts, shorted):
        volts = np.ascontiguousarray(volts, dtype=np.float64)
        if volts.shape != self._no_volts.shape:
            expected = self._no_volts.shape
            raise PkmError(f'plant {self.machine.name}: volts of shape {volts.shape} given; expected {expected}')
        noise, row = self._noise.at(self._index)
        event = advance(*self._arguments, volts, noise, row, self._substeps, shorted)
        if event == REFUSED:
            given = dict(zip(self.machine.joints, volts.tolist(), strict=True))
            raise PkmError(f'plant {self.machine.name}: volts {given} V given; expected finite values')
        self._index += 1
        self._ticks += 1
        if event and self._fault is None:
            self._fault = self._describe(event - 1)
        return self._arrays.counts.copy()

    def _describe(self, contact):
        """Return the fault text for the row `contact` of the contacts, with the present positions."""
        below, above = self._arrays.contacts[contact, :2].astype(int)
        joints, limits, q = self.machine.joints, self.machine.limits, self._arrays.motion[Q] * 1e3
        when = f'{self._ticks * self.machine.sample_time * 1e3:.1f} ms'
        if below >= 0 and above >= 0:
            pair = f'{joints[below]} at {q[below]:.2f} mm and {joints[above]} at {q[above]:.2f} mm'
            return f'{when}: carriages {pair} collided (2.4)'
        joint, end = (above, 'lower') if above >= 0 else (below, 'upper')
        travel = f'{limits.lower[joint] * 1e3:.2f} to {limits.upper[joint] * 1e3:.2f} mm'
        return f'{when}: {joints[joint]} ran into its {end} stop at {q[joint]:.2f} mm; travel is {travel}'
