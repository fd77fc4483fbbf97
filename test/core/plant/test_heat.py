"""Heat: exact temperatures, losses, expansion as the error budget has it, motors, laser, refusals, determinism."""

import numpy as np
import pytest

from pkm_core.design.budget import linear_budget
from pkm_core.design.tolerances import load_tolerances
from pkm_core.errors import ConfigError, PkmError
from pkm_core.machines import load_machine
from pkm_core.plant.changed_truth import changed_machine
from pkm_core.plant.heat import Heat
from pkm_core.plant.laser import Laser
from pkm_core.plant.plant import Plant
from pkm_core.plant.specimen import assemble
from pkm_core.plant.truth import load_truth

FOUR_DOF = load_machine('four_dof')
NODES = 13
HOUR = 3600.0
SQUARE, FRICTION = np.array([6.0, 5.0, 3.0, 2.0]), np.array([0.5, 0.3, 0.2, 0.3])


def heat(**changes):
    """Return the `Heat` of specimen 1 with other levels, and the levels."""
    truth, environment = load_truth(FOUR_DOF, 'warm')
    levels = environment.heat.model_copy(update=changes)
    return Heat(FOUR_DOF, truth.drive, levels, assemble(FOUR_DOF, truth, environment, 1)), levels


def shaken(plant, ticks=300, amplitude=2.0):
    """Move a plant back and forth and return its counts (ticks, n)."""
    sense = amplitude * np.array([1.0, -1.0, 1.0, 0.8])[: len(plant.machine.joints)]
    return np.array([plant.tick(sense * np.cos(0.1 * tick)) for tick in range(ticks)])


def rise_of(plant, kind):
    return np.array([rise for node, rise in plant.temperatures.items() if node.startswith(kind)])


@pytest.mark.parametrize('copper', [0.0, 0.0039])
def test_lone_node_follows_the_first_order_solution(copper):
    """T = P/G' (1 - exp(-t G'/C)); the growth of the resistance reduces the conductance to G' = G - copper P."""
    apart = {'motor_to_link': 0.0, 'motor_to_scale': 0.0, 'link_to_platform': 0.0, 'friction_to_scale': 0.0}
    warm, levels = heat(**apart, copper=copper)
    loss = 0.75 * 0.96 * SQUARE  # three phases of R / 2
    for seconds in (100.0, 900.0, HOUR):
        warm.reset()
        warm.pass_time(seconds, SQUARE, FRICTION)
        G = levels.motors.to_ambient - copper * loss
        expected = (loss + FRICTION) / G * (1.0 - np.exp(-seconds * G / levels.motors.capacity))
        np.testing.assert_allclose(warm.rise[:4], expected, rtol=1e-12)
        np.testing.assert_array_equal(warm.rise[4:], 0.0)


def test_steady_state_gives_all_losses_to_the_room():
    warm, levels = heat()
    warm.pass_time(1e6, SQUARE, FRICTION)
    motors, links, scales, platform = np.split(warm.rise, [4, 8, 12])
    losses = (0.75 * 0.96 * SQUARE * (1.0 + levels.copper * motors) + FRICTION).sum()
    kinds = (levels.motors, motors), (levels.links, links), (levels.scales, scales), (levels.platform, platform)
    given = sum(node.to_ambient * rise.sum() for node, rise in kinds)
    assert given == pytest.approx(losses, rel=1e-9)
    assert motors[0] > links[0] > platform[0] > 0.0
    assert warm.rise[0] - links[0] == pytest.approx(  # what leaves a motor for its link, leaves the link
        (levels.links.to_ambient * links[0] + levels.link_to_platform * (links[0] - platform[0]))
        / levels.motor_to_link,
        rel=1e-9,
    )


def test_stored_heat_is_what_the_room_did_not_take():
    """Energy over an hour, the heat given to the room by Simpson's rule."""
    warm, levels = heat(copper=0.0)
    nodes = (levels.motors,) * 4 + (levels.links,) * 4 + (levels.scales,) * 4 + (levels.platform,)
    capacity, to_room = (np.array([getattr(node, key) for node in nodes]) for key in ('capacity', 'to_ambient'))
    steps = 360
    given = [0.0]
    for _ in range(steps):
        warm.pass_time(HOUR / steps, SQUARE, FRICTION)
        given.append(to_room @ warm.rise)
    taken = HOUR / steps / 3.0 * (given[0] + given[-1] + 4.0 * sum(given[1:-1:2]) + 2.0 * sum(given[2:-1:2]))
    entered = HOUR * (0.75 * 0.96 * SQUARE + FRICTION).sum()
    assert capacity @ warm.rise + taken == pytest.approx(entered, rel=1e-7)


def test_duration_may_be_divided():
    whole, parts = heat()[0], heat()[0]
    whole.pass_time(1000.0, SQUARE, FRICTION)
    for _ in range(10):
        parts.pass_time(100.0, SQUARE, FRICTION)
    np.testing.assert_allclose(parts.rise, whole.rise, rtol=1e-12)


def test_losses_are_those_of_current_and_friction():
    plant = Plant(FOUR_DOF, 1, 'warm')
    square, ticks = np.zeros(4), 200
    for tick in range(ticks):
        plant.tick(np.array([2.0, -1.0, 0.5, 1.0]) * np.cos(0.1 * tick))
        square += plant.truth.current**2
    plant.start_cycle(1)
    expected, levels = heat(friction_to_scale=1.0)
    with changed_machine(FOUR_DOF, 'warm', _all_friction_to_scales) as machine:
        plant = Plant(machine, 1, 'warm')
        for tick in range(ticks):
            plant.tick(np.array([2.0, -1.0, 0.5, 1.0]) * np.cos(0.1 * tick))
        plant.start_cycle(1)
    expected.pass_time(0.1, square / ticks, np.zeros(4))
    np.testing.assert_allclose(rise_of(plant, 'motor'), expected.rise[:4], rtol=1e-6)
    energy = levels.scales.capacity * rise_of(plant, 'scale')  # [J] over 0.1 s, of friction and 1e-5 from the motors
    assert (energy > 0.0).all()
    assert (energy < 0.1 * 3.0).all()


def _all_friction_to_scales(truth):
    truth['environments']['warm']['heat']['friction_to_scale'] = '100 %'


@pytest.mark.parametrize(('name', 'axis', 'per_kelvin'), [('four_dof', 2, 3.31), ('planar', 1, 2.02)])
def test_end_point_drifts_per_kelvin_as_in_the_budget(name, axis, per_kelvin):
    """All links, offsets and platforms 1 K warmer, then all scales: two sources of the budget."""
    machine = load_machine(name)
    n = len(machine.joints)
    cold = Plant(machine, 1, 'warm').truth.pose
    budget = linear_budget(machine.drawing, load_tolerances(), machine.home[np.newaxis])
    nodes = {'links warm': [*range(n, 2 * n), 3 * n], 'scales warm': range(2 * n, 3 * n)}
    spread = {'links warm': 1.0, 'scales warm': 0.5}  # [K], of the budget
    for source, deviation in zip(budget.sources, budget.deviations[:, 0], strict=True):
        if source.name in nodes:
            rise = np.zeros(3 * n + 1)
            rise[list(nodes[source.name])] = spread[source.name]
            moved = np.abs(Plant(machine, 1, 'warm', rise).truth.pose - cold)
            np.testing.assert_allclose(moved, deviation, rtol=3e-3, atol=5e-9)  # of a specimen
            if source.name == 'links warm':
                assert 1e6 * moved[axis] == pytest.approx(per_kelvin, abs=0.01)


@pytest.mark.parametrize('name', ['four_dof', 'planar'])
def test_first_cycle_has_the_bits_of_nominal(name):
    machine = load_machine(name)
    found = []
    for environment in ('nominal', 'warm'):
        plant = Plant(machine, 3, environment)
        plant.start_cycle(1)
        counts = shaken(plant)
        braked = list(plant.brake(50))
        found.append((counts, braked, plant.truth.pose))
    for nominal, warm in zip(*found, strict=True):
        np.testing.assert_array_equal(nominal, warm)


def test_heat_without_effects_has_the_bits_of_nominal():
    with changed_machine(FOUR_DOF, 'warm', _without_effects) as machine:
        plants = [Plant(FOUR_DOF, 3), Plant(machine, 3, 'warm')]
        for cycle in (1, 2):
            for plant in plants:
                plant.start_cycle(cycle)
            np.testing.assert_array_equal(*(shaken(plant) for plant in plants))
            np.testing.assert_array_equal(*(plant.truth.pose for plant in plants))
            for plant in plants:
                plant.pass_time(HOUR, repeating=True)
    assert plants[0].temperatures == {}
    assert plants[1].temperatures['motor d1'] > 1.0


def _without_effects(truth):
    truth['environments']['warm']['heat'] |= {'copper': '0 %/K', 'magnets': '0 %/K', 'links_expand': '0 1/K'}
    truth['environments']['warm']['heat']['scales_expand'] = '0 1/K'


@pytest.mark.parametrize('name', ['four_dof', 'planar', 'xy_stage'])
def test_no_other_environment_has_heat(name):
    truth, _ = load_truth(load_machine(name), 'nominal')
    assert [key for key, level in truth.environments.items() if level.heat] == ['warm'] * (name != 'xy_stage')


def test_warm_motors_push_and_brake_less():
    """20 K: thrust 2 % lower; brake force by (1 - 0.02)^2 over 1 + 0.078 of the resistance."""
    rise = np.zeros(NODES)
    rise[:4] = 20.0
    thrusts, speeds = [], []
    for each in (None, rise):
        plant = Plant(FOUR_DOF, 1, 'warm', each)
        for _ in range(10):
            plant.tick(np.array([4.0, 4.0, 4.0, 4.0]))
        thrusts.append(plant.truth.thrust)
        start = plant.truth.qd
        for _ in plant.brake(20):
            pass
        speeds.append(plant.truth.qd / start)
    np.testing.assert_allclose(thrusts[1] / thrusts[0], 0.98, atol=1e-3)  # ripple: not quite at the same place
    assert (speeds[1] > speeds[0]).all()


def test_machine_cools_at_rest_and_is_cold_after_a_reset():
    plant = Plant(FOUR_DOF, 1, 'warm')
    first = shaken(plant)
    plant.pass_time(HOUR, repeating=True)
    hot = plant.temperatures
    plant.pass_time(HOUR)
    plant.start_cycle(1)
    assert hot['motor d1'] > 10.0 * plant.temperatures['motor d1'] > 0.0
    plant.reset()
    assert set(plant.temperatures.values()) == {0.0}
    np.testing.assert_array_equal(shaken(plant), first)


def test_laser_reads_the_drift_with_the_same_bits_in_any_blocks():
    """A block may begin with a tick of the cycle before, when the machine was colder."""
    seen = []
    for block in (10**6, 20, 7):
        plant, laser, rows = Plant(FOUR_DOF, 1, 'warm'), Laser(FOUR_DOF, 1, 'warm'), []
        laser.zero(0, plant.truth)
        for tick in range(1, 601):
            plant.tick(np.array([1.0, -1.0, 1.0, 1.0]) * np.cos(0.3 * tick))
            laser.observe(tick, plant.truth)
            if tick % block == 0 or tick % 300 == 0:
                rows.append(laser.read().displacement)
            if tick == 300:
                plant.pass_time(HOUR, repeating=True)
                plant.start_cycle(1)
        seen.append(np.concatenate(rows))
    for other in seen[1:]:
        np.testing.assert_array_equal(seen[0], other)
    assert abs(seen[0][-1] - seen[0][180])[2] > 1e-6


@pytest.mark.parametrize(
    ('key', 'value', 'message'),
    [
        ('copper', '-0.39 %/K', r"heat\.copper: '-0.39 %/K' given"),
        ('copper', '0.0039', r'heat\.copper: .*0.0039'),
        ('magnets', '0.1 %/K', r"heat\.magnets: '0.1 %/K' given"),
        ('links_expand', '23.1e-3 1/K', r"heat\.links_expand: '23.1e-3 1/K' given"),
        ('scales_expand', '8 um', r"heat\.scales_expand: '8 um' has the dimension"),
        ('friction_to_scale', '150 %', r"heat\.friction_to_scale: '150 %' given"),
        ('motor_to_link', '-1 W/K', r"heat\.motor_to_link: '-1 W/K' given"),
        ('motors', {'capacity': '0 J/K', 'to_ambient': '1 W/K'}, r"heat\.motors\.capacity: '0 J/K' given"),
        ('motors', {'capacity': '2 J/K', 'to_ambient': '1 W/K'}, r'motors: time constant of 1.69.* s given.*10 s'),
        ('motors', {'capacity': '2 J/K'}, r'heat\.motors\.to_ambient'),
        ('collors', '1 W/K', 'collors'),
    ],
)
def test_unphysical_heat_is_refused_by_key(key, value, message):
    with (
        changed_machine(
            FOUR_DOF, 'warm', lambda truth: truth['environments']['warm']['heat'].update({key: value})
        ) as m,
        pytest.raises(ConfigError, match=rf'four_dof\.yaml: .*environments\.warm.*{message}'),
    ):
        load_truth(m, 'warm')


def test_nodes_that_never_cool_are_refused():
    def insulated(truth):
        nodes = truth['environments']['warm']['heat']
        for name in ('motors', 'links', 'platform', 'scales'):
            nodes[name]['to_ambient'] = '0 W/K'

    with changed_machine(FOUR_DOF, 'warm', insulated) as machine, pytest.raises(ConfigError, match='at least one'):
        load_truth(machine, 'warm')


def test_heat_of_a_machine_without_links_is_refused():
    stage = load_machine('xy_stage')
    levels = load_truth(FOUR_DOF, 'warm')[1].heat
    truth, environment = load_truth(stage, 'nominal')
    with pytest.raises(ConfigError, match='xy_stage has no links'):
        Heat(stage, truth.drive, levels, assemble(stage, truth, environment, 1))


@pytest.mark.parametrize(
    ('environment', 'rise', 'message'),
    [
        ('nominal', np.zeros(NODES), "'nominal' of four_dof has no section heat"),
        ('warm', np.zeros(4), '13 values'),
        ('warm', np.full(NODES, np.nan), 'nan.*at most 200 K'),
        ('warm', np.full(NODES, 300.0), 'at most 200 K'),
    ],
)
def test_wrong_temperatures_at_power_up_are_refused(environment, rise, message):
    with pytest.raises(PkmError, match=message):
        Plant(FOUR_DOF, 1, environment, rise)


@pytest.mark.parametrize('seconds', [-1.0, np.nan, np.inf])
def test_wrong_pause_is_refused_and_changes_nothing(seconds):
    plant = Plant(FOUR_DOF, 1, 'warm')
    before = plant.temperatures
    with pytest.raises(PkmError, match='s given; allowed: finite values from 0'):
        plant.pass_time(seconds)
    assert plant.temperatures == before
