"""The observer law of one axis compared with its linear system, and its behaviour at the limits and between cycles."""

import numpy as np
import pytest

from pkm_core.config import find_config
from pkm_core.control.controllers import choose_control, kind_of
from pkm_core.control.margins import require_stable_set, stability_margins, worst_margins
from pkm_core.control.model import load_model
from pkm_core.control.observer import ObserverController, load_observer
from pkm_core.control.observer_design import ObserverLaw
from pkm_core.control.systems import plant_system
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.motion.planning import default_motion, load_motion, plan
from pkm_core.motion.trajectory import to_joints
from pkm_core.tuning.config import load_tuning

MACHINES = {name: load_machine(name) for name in ('four_dof', 'planar', 'xy_stage')}
MACHINE = MACHINES['planar']
TS, LIMIT = MACHINE.sample_time, MACHINE.voltage_limit
MODEL = load_model(MACHINE)['d3']
LAW = load_observer(MACHINE)['d3']
TRAJECTORY = to_joints(MACHINE, plan(MACHINE, load_motion(default_motion(MACHINE))))
AXIS = [np.ascontiguousarray(rows[:, 1]) for rows in TRAJECTORY.derivatives()]


def controller(law=LAW, model=MODEL, limit=LIMIT):
    return ObserverController(law, model, TS, limit)


def load(axis, position, learned=None):
    rest = np.zeros(len(position))
    axis.load(position, rest, rest, rest, rest if learned is None else learned)


def drive(axis, model, cycle, disturbance=0.0, learned=None, plant=None):
    """Run `axis` on the model for a cycle of `AXIS`; return voltage, error and the plant for the next cycle."""
    system = plant_system(model, TS)
    axis.load(*cycle, np.zeros(len(cycle[0])) if learned is None else learned)
    x = np.zeros(system.B.size) if plant is None else plant
    rows = []
    for index in range(len(cycle[0])):
        voltage, error = axis.update(index, cycle[0][0] + float(system.C[0] @ x))
        rows.append((voltage, error))
        x = system.A @ x + system.B[:, 0] * (voltage + disturbance)
    return *np.array(rows).T, x


def test_update_equals_the_linear_system_of_the_law():
    """Also the margins, which use that system, are those of what runs."""
    rng = np.random.default_rng(1)
    position, measured = 1e-5 * rng.standard_normal((2, 300))
    axis, system = controller(limit=1e6), LAW.system(TS)
    load(axis, position)
    voltage = np.array([axis.update(index, value)[0] for index, value in enumerate(measured)])
    x, expected = np.zeros(system.B.size), []
    for error in position - measured:
        expected.append(float(system.C[0] @ x) + system.D * error)
        x = system.A @ x + system.B[:, 0] * error
    np.testing.assert_allclose(voltage, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


def test_feedforward_alone_drives_the_model_within_50_nm():
    """The inverse includes the right-half-plane zeros of d3, by preview. The PID's (7.24) leaves micrometres."""
    voltage, error, _ = drive(controller(), MODEL, AXIS)
    assert np.abs(error).max() < 50e-9
    assert 1.0 < np.abs(voltage).max() < LIMIT


def test_constant_force_leaves_no_error_at_the_end():
    """The disturbance state integrates."""
    _, error, _ = drive(controller(), MODEL, AXIS, disturbance=0.3)
    assert np.abs(error).max() > 0.5e-6
    assert np.abs(error[-50:]).max() < 20e-9


def test_saturation_winds_nothing_up():
    """An axis held for 50 ticks 1 mm off its reference returns to it without passing it by more than a fifth."""
    system, axis = plant_system(MODEL, TS), controller(limit=2.0)
    load(axis, np.zeros(1500))
    x, course = np.zeros(system.B.size), []
    for index in range(1500):
        held = index < 50
        measured = -1e-3 if held else -1e-3 + float(system.C[0] @ x)
        voltage, _ = axis.update(index, measured)
        assert abs(voltage) <= 2.0
        x = x if held else system.A @ x + system.B[:, 0] * voltage
        course.append(measured)
    assert axis.saturated >= 50
    assert max(course) < 0.2e-3
    assert abs(course[-1]) < 1e-6


def test_new_level_of_feedforward_keeps_the_voltage():
    axis = controller()
    load(axis, np.zeros(200), np.full(200, 0.2))
    before = [axis.update(index, 1e-7)[0] for index in range(200)][-1]
    load(axis, np.zeros(200), np.full(200, 0.5))
    assert axis.update(0, 1e-7)[0] == pytest.approx(before, abs=5e-3)


@pytest.mark.parametrize('modes', [2, 1])
def test_exchange_in_motion_keeps_the_voltage_continuous(modes):
    """Also for a model with another number of modes; the step of one tick is that of the motion itself."""
    model = MODEL.model_copy(update={'modes': MODEL.modes[:modes], 'gain': 1.02 * MODEL.gain})
    weights = LAW.weights.model_copy(update={'effort': 1.2 * LAW.weights.effort})
    system, axis = plant_system(MODEL, TS), controller()
    axis.load(*AXIS, np.zeros(len(AXIS[0])))
    x, voltages = np.zeros(system.B.size), []
    for index in range(len(AXIS[0])):
        if index == 100:
            axis.exchange(LAW.model_copy(update={'weights': weights}), model)
        voltage, error = axis.update(index, AXIS[0][0] + float(system.C[0] @ x))
        assert abs(error) < 50e-6
        voltages.append(voltage)
        x = system.A @ x + system.B[:, 0] * voltage
    steps = np.abs(np.diff(voltages))
    assert steps[99] < 1.5 * steps[80:120].mean() + 0.05
    assert axis.gains.model == model


def test_exchange_for_the_same_law_changes_no_bit():
    one, other = controller(), controller()
    for axis in (one, other):
        load(axis, np.zeros(60))
        for index in range(30):
            axis.update(index, 1e-6 * np.sin(index))
    other.exchange(LAW)
    for index in range(30, 60):
        assert one.update(index, 0.0)[0] == pytest.approx(other.update(index, 0.0)[0], abs=1e-12)


def test_weights_unstable_within_the_uncertainty_are_refused():
    """A filter that trusts its model of the modes: stable on the model itself only."""
    eager = {'effort': 5e-8, 'speed': 0.0, 'force_noise': 1.0, 'drift': 0.5, 'mode_noise': 0.0, 'mode_damping': 1.0}
    law = ObserverLaw(weights=LAW.weights.model_copy(update=eager), model=MODEL)
    assert stability_margins(law, MODEL, TS).stable
    with pytest.raises(PkmError, match='d3: the loop is unstable within the uncertainty of its model, at gain'):
        require_stable_set('d3', law, MODEL, TS)


def test_exchange_for_an_unstable_loop_is_refused_with_the_pole():
    axis, before = controller(), controller().gains
    turned = MODEL.model_copy(update={'gain': 30.0 * MODEL.gain})

    class Fixed(ObserverLaw):
        """A law that keeps its design."""

        def on(self, model):
            return self

    with pytest.raises(PkmError, match='new gains: the loop is unstable: slowest pole'):
        axis.exchange(Fixed(weights=LAW.weights, model=MODEL), turned)
    assert axis.gains == before


@pytest.mark.parametrize('name', MACHINES)
def test_shipped_weights_keep_the_limits_of_the_tuning(name):
    machine, limits = MACHINES[name], load_tuning('observer').limits
    for joint, law in load_observer(machine).items():
        model = load_model(machine)[joint]
        for judge, keep in ((stability_margins, limits.nominal), (worst_margins, limits.perturbed)):
            margins = judge(law, model, machine.sample_time)
            assert margins.stable, joint
            assert margins.gain_margin >= keep.gain_margin, joint
            assert margins.phase_margin >= np.degrees(keep.phase_margin), joint
            assert margins.peak_sensitivity <= keep.peak_sensitivity, joint


def test_observer_is_chosen_by_kind_name_and_keys(tmp_path):
    path = find_config('control/observer', 'planar')
    copy = tmp_path / 'mine.yaml'
    copy.write_text(path.read_text())
    for chosen in ('observer', str(path), str(copy)):
        assert kind_of(choose_control(MACHINE, chosen)) == 'observer'


@pytest.mark.parametrize(
    ('old', 'new', 'reason'),
    [
        ('um/V', 'um', 'joints.d1.effort: .* is not a quantity in m/V|effort'),
        ('effort:', 'efort:', 'joints.d1.efort'),
        ('mode_damping: ', 'mode_damping: -', 'joints.d1.mode_damping'),
    ],
)
def test_unfit_weights_are_refused_with_key(tmp_path, old, new, reason):
    path = tmp_path / 'planar.yaml'
    path.write_text(find_config('control/observer', 'planar').read_text().replace(old, new, 1))
    with pytest.raises(ConfigError, match=reason):
        load_observer(MACHINE, str(path))
