"""The lock-step executor in a thread, with nodes that answer each other's messages."""

from threading import Thread
from time import monotonic, process_time, sleep

import pytest
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from std_msgs.msg import UInt64
from std_srvs.srv import Trigger

from pkm_nodes.messages.tick_messages import UINT64
from pkm_nodes.runtime.alarm import Alarm
from pkm_nodes.runtime.groups import PatientGroup
from pkm_nodes.runtime.lockstep import LockstepExecutor
from pkm_nodes.runtime.node import TICK_QOS, PkmNode


class Player(PkmNode):
    """Answers every number on one tick topic with the next one on another, up to `last`; raises at `poison`."""

    def __init__(self, name, hears, says, **kwargs):
        super().__init__(name, **kwargs)
        self.last = 0
        self.poison = None
        self.heard = []
        self.timer_calls = 0
        self.alarm = Alarm(self, self._on_alarm)
        self.lags = []  # [s] from the time of the alarm to its ring
        self.period, self.rings = 0.0, 0  # [s] between alarms, and how many are left
        self.ball = self.setting('ball', 'red', 'what is played with')
        self._publisher = self.create_publisher(UInt64, says, TICK_QOS)
        self.subscription = self.on_tick_topic(UInt64, hears, self._on_number, size=UINT64.size)
        self.create_service(Trigger, f'{name}/greet', self._on_greet)
        self.create_service(Trigger, f'{name}/await', self._on_await)
        self.create_service(Trigger, f'{name}/ring', self._on_ring)
        self.awaited = None
        self.create_timer(0.01, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_number(self, data):
        (number,) = UINT64.unpack(data)
        self.heard.append(number)
        if number == self.poison:
            raise ZeroDivisionError(number)
        if number < self.last:
            self._publisher.publish(UInt64(data=number + 1))

    def _on_alarm(self):
        self.lags.append(monotonic() - self.due)
        self._next_alarm()

    def _next_alarm(self):
        if self.rings:
            self.rings -= 1
            self.due = monotonic() + self.period
            self.alarm.set(self.due)

    def _on_ring(self, _, response):
        """Begin the alarms."""
        self._next_alarm()
        return response

    async def _on_await(self, _, response):
        """Answer when the test sets the future `awaited`."""
        self.awaited = Future()
        response.message = await self.awaited
        response.success = True
        return response

    def _on_greet(self, _, response):
        response.success, response.message = True, f'{len(self.heard)}'
        return response

    def _on_timer(self):
        self.timer_calls += 1


class Listener(PkmNode):
    """Receives the numbers of both players in a `PatientGroup`."""

    def __init__(self, **kwargs):
        super().__init__('listener', **kwargs)
        self.heard = []
        self.turns = 0
        group = PatientGroup(self._on_emptied)
        for topic in ('ping_says', 'pong_says'):
            self.create_subscription(UInt64, topic, self._on_numbers, TICK_QOS, callback_group=group, raw=True)

    def _on_numbers(self, messages, _):
        self.heard += [deserialize_message(message.tobytes(), UInt64).data for message in messages]

    def _on_emptied(self):
        self.turns += 1


class Game:
    """Two players and a listener in a lock-step executor that runs in a thread."""

    def __init__(self, domain_id):
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain_id, signal_handler_options=SignalHandlerOptions.NO)
        self.players = [
            Player('ping', 'pong_says', 'ping_says', context=self.context),
            Player('pong', 'ping_says', 'pong_says', context=self.context),
        ]
        self.listener = Listener(context=self.context)
        self.error = None
        self._executor = LockstepExecutor(context=self.context)
        for node in (*self.players, self.listener):
            self._executor.add_node(node)
        self._thread = Thread(target=self._run)
        self._thread.start()

    def _run(self):
        try:
            self._executor.spin()
        except ExternalShutdownException:
            pass
        except ZeroDivisionError as error:
            self.error = error

    def allow(self, last):
        """Let the players answer numbers below `last`."""
        for player in self.players:
            player.last = last

    def heard(self):
        """Return all numbers in the order in which they were sent."""
        return sorted(self.players[0].heard + self.players[1].heard)

    def has_ended(self):
        return not self._thread.is_alive()

    def end(self):
        self.allow(0)
        sleep(0.1)  # the last number is in the net; what is published after the shutdown would be an error
        rclpy.shutdown(context=self.context)
        self._thread.join(timeout=30)
        for node in (*self.players, self.listener):
            node.destroy_node()


@pytest.fixture
def game(domain_id):
    game = Game(domain_id)
    yield game
    game.end()
    assert game.has_ended()


@pytest.fixture
def serve(graph, game):
    """Return a function that sends a number to pong."""
    publisher = graph.publisher(UInt64, 'ping_says')
    graph.spin_until(lambda: publisher.get_subscription_count() == 2, 'pong and the listener to listen')
    return lambda number: publisher.publish(UInt64(data=number))


def test_every_message_is_served_once_and_in_order(graph, game, serve):
    game.allow(2000)
    serve(1)
    graph.spin_until(lambda: len(game.heard()) == 2000, 'number 2000')
    ping, pong = game.players
    assert pong.heard == list(range(1, 2001, 2))
    assert ping.heard == list(range(2, 2001, 2))


def test_patient_group_gets_all_messages_in_few_turns(graph, game, serve):
    game.allow(2000)
    serve(1)
    graph.spin_until(lambda: len(game.listener.heard) == 2000, 'number 2000')
    assert sorted(game.listener.heard) == list(range(1, 2001))
    assert game.listener.turns < 1000


def test_messages_that_wait_together_are_all_served(graph, game, serve):
    game.allow(0)
    for number in range(1, 501):
        serve(number)
    graph.spin_until(lambda: len(game.heard()) == 500, 'all 500 numbers')
    assert game.players[1].heard == list(range(1, 501))


def test_tap_gets_every_message_before_the_subscriber(graph, game, serve):
    """Set while the executor runs and the flow is on."""
    game.allow(100)
    serve(1)
    graph.spin_until(lambda: len(game.heard()) == 100, 'number 100')
    pong, tapped = game.players[1], []
    pong.subscription.tap(lambda data: tapped.append((*UINT64.unpack(data), len(pong.heard))))
    game.allow(300)
    serve(101)
    graph.spin_until(lambda: len(game.heard()) == 300, 'number 300')
    assert tapped == [(number, 50 + index) for index, number in enumerate(range(101, 301, 2))]


def test_flow_begins_again_after_a_silence(graph, game, serve):
    game.allow(100)
    serve(1)
    graph.spin_until(lambda: len(game.heard()) == 100, 'number 100')
    graph.spin_in_silence()
    game.allow(200)
    serve(101)
    graph.spin_until(lambda: len(game.heard()) == 200, 'number 200')
    assert game.heard() == list(range(1, 201))


def test_other_entities_are_served_while_ticks_flow(graph, game, serve):
    game.allow(10**9)  # without an end
    serve(1)
    graph.spin_until(lambda: len(game.players[0].heard) > 100, 'the flow')
    before, timer_calls = len(game.players[0].heard), game.players[0].timer_calls

    values = graph.call(GetParameters, 'ping/get_parameters', GetParameters.Request(names=['ball'])).values
    assert values[0].string_value == 'red'
    greeting = graph.call(Trigger, 'pong/greet')
    assert greeting.success
    graph.spin_until(lambda: game.players[0].timer_calls > timer_calls, 'the timer')
    graph.spin_until(lambda: len(game.players[0].heard) > before + 1000, 'the flow to continue')


def test_awaiting_callback_blocks_its_group_and_resumes(graph, game):
    pong = game.players[1]
    awaits, greets = (graph.node.create_client(Trigger, f'pong/{what}') for what in ('await', 'greet'))
    graph.spin_until(lambda: awaits.service_is_ready() and greets.service_is_ready(), 'the services of pong')
    awaited = awaits.call_async(Trigger.Request())
    graph.spin_until(lambda: pong.awaited is not None, 'the callback to be called')
    timer_calls = pong.timer_calls
    greeting = greets.call_async(Trigger.Request())
    graph.spin_in_silence()
    assert not greeting.done()
    assert pong.timer_calls <= timer_calls + 1  # one may have been under way
    pong.awaited.set_result('now')
    graph.spin_until(lambda: awaited.done() and greeting.done(), 'both answers')
    assert awaited.result().message == 'now'


def ring(graph, game, period, rings):
    """Let ping set an alarm `rings` times, each `period` [s] after the one before has rung."""
    ping = game.players[0]
    ping.period, ping.rings, ping.lags = period, rings, []
    graph.call(Trigger, 'ping/ring')
    return ping


def test_alarm_rings_as_often_as_it_was_set_and_never_early(graph, game):
    ping = ring(graph, game, 1e-3, 200)
    graph.spin_until(lambda: len(ping.lags) == 200, 'the alarms')
    graph.spin_in_silence()
    assert len(ping.lags) == 200
    assert min(ping.lags) >= 0.0


def test_ticks_and_others_are_served_while_an_alarm_is_set(graph, game, serve):
    ping = ring(graph, game, 3600.0, 1)
    calls = ping.timer_calls
    game.allow(500)
    serve(1)
    graph.spin_until(lambda: len(game.heard()) == 500, 'number 500')
    graph.spin_until(lambda: len(game.listener.heard) == 500, 'the listener')
    assert graph.call(Trigger, 'pong/greet').success
    graph.spin_until(lambda: ping.timer_calls > calls, 'the timer')
    assert ping.lags == []


def test_alarm_replaces_the_one_set_before(graph, game):
    ring(graph, game, 3600.0, 1)
    ping = ring(graph, game, 0.01, 1)
    graph.spin_until(lambda: ping.lags, 'the alarm')
    graph.spin_in_silence()
    assert len(ping.lags) == 1


def test_alarm_rings_although_entities_come_and_go(graph, game):
    """The executor then collects its entities again."""
    ping = ring(graph, game, 1e-3, 100)
    while len(ping.lags) < 100:
        game.players[1].destroy_timer(game.players[1].create_timer(3600.0, lambda: None))
        graph.spin_until(lambda: True, 'one turn')
        sleep(0.002)


def test_idle_executor_costs_no_cpu(graph, game, serve):
    for player in game.players:
        for timer in list(player.timers):
            player.destroy_timer(timer)
    game.allow(100)
    serve(1)
    graph.spin_until(lambda: len(game.heard()) == 100, 'number 100')
    graph.spin_in_silence()
    before = process_time()
    sleep(0.5)
    assert process_time() - before < 0.1


def test_error_in_a_callback_of_the_tick_ends_the_executor(graph, game, serve):
    game.players[0].poison = 2
    game.allow(100)
    serve(1)
    graph.spin_until(game.has_ended, 'the executor to end')
    assert game.error.args == (2,)
