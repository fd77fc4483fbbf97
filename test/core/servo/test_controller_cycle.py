"""States of a controller between trajectories: event in; next state and action out."""

import pytest

from pkm_core.servo.controller_cycle import NO_CYCLE, Action, ControllerCycle, ControllerState

STANDING, WAITING, LOADED, RUNNING = ControllerState


def cycle_in(state, number=5):
    """Return a `ControllerCycle` in `state` with cycle `number`."""
    cycle = ControllerCycle(discovery=2.0)
    if state is not STANDING:
        cycle.wait_for(number, f'cycle {number}', now=10.0)
    if state in (LOADED, RUNNING):
        cycle.begin()
        cycle.loaded()
    cycle.running = state is RUNNING
    return cycle


@pytest.mark.parametrize('state', ControllerState)
def test_state_follows_from_the_events(state):
    cycle = cycle_in(state)
    assert cycle.state is state
    assert cycle.active == (5 if state in (LOADED, RUNNING) else NO_CYCLE)
    assert cycle.waiting == ('cycle 5' if state is WAITING else None)


@pytest.mark.parametrize(
    ('state', 'number', 'action'),
    [
        (STANDING, 5, Action.ACCEPT),
        (WAITING, 5, Action.ACCEPT),
        (WAITING, 6, Action.ACCEPT),
        (LOADED, 5, Action.REPORT),
        (LOADED, 6, Action.ACCEPT),
        (RUNNING, 5, Action.REPORT),
        (RUNNING, 6, Action.REFUSE),
    ],
)
def test_action_on_a_trajectory(state, number, action):
    cycle = cycle_in(state)
    assert cycle.on_trajectory(number) is action
    assert cycle.state is state, 'a trajectory that fails its checks changes nothing'


@pytest.mark.parametrize('state', [STANDING, WAITING, LOADED])
def test_accepted_trajectory_replaces_the_previous_one(state):
    cycle = cycle_in(state)
    cycle.wait_for(6, 'cycle 6', now=11.0)
    assert (cycle.state, cycle.active, cycle.waiting) == (WAITING, NO_CYCLE, 'cycle 6')


def test_law_that_refuses_a_cycle_leaves_the_controller_standing():
    cycle = cycle_in(WAITING)
    assert cycle.begin() == 'cycle 5'
    assert (cycle.state, cycle.last) == (STANDING, 5)


@pytest.mark.parametrize(
    ('before', 'after'), [(STANDING, STANDING), (WAITING, WAITING), (LOADED, STANDING), (RUNNING, STANDING)]
)
def test_end_drops_the_active_cycle_only(before, after):
    """The trajectory of the next cycle may arrive before the reset of the machine is served."""
    cycle = cycle_in(before)
    cycle.end()
    assert (cycle.state, cycle.active) == (after, NO_CYCLE)


@pytest.mark.parametrize(
    ('state', 'number', 'stopped'), [(STANDING, 5, False), (LOADED, 5, False), (RUNNING, 5, True), (RUNNING, 6, False)]
)
def test_stop_means_the_running_cycle_only(state, number, stopped):
    assert cycle_in(state).is_stopped_by(number) is stopped


@pytest.mark.parametrize(
    ('known', 'connected', 'now', 'enough'),
    [
        (0, 0, 11.0, False),  # a command without any reader is useless
        (2, 1, 11.0, False),
        (2, 2, 11.0, True),
        (2, 1, 12.5, True),  # 2 s after the trajectory one reader is enough
        (2, 0, 12.5, False),
    ],
)
def test_known_readers_are_waited_for_during_discovery(known, connected, now, enough):
    assert cycle_in(WAITING).is_connected(known, connected, now) is enough


@pytest.mark.parametrize(('number', 'enough'), [(5, True), (6, False)])
def test_trajectory_sent_again_does_not_extend_the_discovery(number, enough):
    """A trajectory is sent again every second until its cycle starts."""
    cycle = cycle_in(WAITING)
    cycle.wait_for(number, 'again', now=11.9)
    assert cycle.is_connected(2, 1, now=12.5) is enough
