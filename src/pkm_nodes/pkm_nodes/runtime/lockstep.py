"""
The executor of the servo tick.

A tick is a chain of short callbacks: encoder samples trigger the controllers, their commands trigger the machine. For
each callback the executors of rclpy inspect every service, timer, parameter and event of every node in Python: 0.3 ms
per callback for one node, several for a composed cell. This executor differs in four points:

- The subscriptions of the tick, those in a `HotGroup`, have a wait set of their own. While samples flow, only this one
  is waited on, and messages go directly to the callbacks, without a task, a lock or a lookup.
- Subscriptions in a `PatientGroup`, those of a recorder, do not wake the executor. Their queues are emptied every
  `_EMPTY_EVERY`, many messages at a time (queues.py).
- The entities of a wait set are collected once, and again only when an entity is created or destroyed. A poll of all
  others takes microseconds. It is done every `_SERVE_EVERY` while samples flow, for parameters, services and timers.
  Without samples the executor sleeps until an entity is ready.
- An alarm (alarm.py) is served in the loop of the tick. While one is set, the loop continues without samples.

Every publisher and subscription has two quality-of-service events. They are half of all entities and rarely ready, so
they are polled every `_EVENTS_EVERY`.

It uses the parts of rclpy that the executors of rclpy use. Many are not public: fast_path.py checks them.
"""

from contextlib import ExitStack
from time import monotonic, perf_counter, sleep

from rclpy.event_handler import EventHandler
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.logging import get_logger
from rclpy.subscription import Subscription
from rclpy.task import Task

from pkm_core.errors import PkmError
from pkm_nodes.runtime.denials import NONE
from pkm_nodes.runtime.groups import HotGroup, PatientGroup
from pkm_nodes.runtime.log_throttle import LogThrottle
from pkm_nodes.runtime.queues import Taker
from pkm_nodes.runtime.sender_takes import SenderTakes
from pkm_nodes.runtime.tick_take import MALFORMED, STRANGER, TickTake, take_one
from pkm_nodes.runtime.waiting import Waiting

# [s] period at which all other entities are served while ticks flow, and the largest share of the time for it: on a
# loaded computer this takes long, and the period grows
_SERVE_EVERY = 0.05
_SERVE_SHARE = 0.05
# [ns] time without a tick after which all entities are waited for
_QUIET = 300_000
# [s] period at which patient subscriptions are emptied: some 200 ticks, of the thousand their queues hold
_EMPTY_EVERY = 0.02
# most messages taken from one of them in a turn, so that a fast publisher does not block the others
_EMPTY_AT_MOST = 1000
# [s] period at which quality-of-service events are polled, and the longest sleep
_EVENTS_EVERY = 1.0
# [s] end of the wait for an alarm that is spent without sleep: the operating system wakes a process that late
_SPIN = 100e-6
# [s] pause when a callback is due in a group of which another callback awaits a future
_SUSPENDED = 0.001
_log_dropped = LogThrottle(get_logger('pkm'), is_error=True)


class LockstepExecutor(SenderTakes, Executor):
    """A single-threaded executor that serves the subscriptions in `HotGroup`s first."""

    def __init__(self, *, context=None):
        self._outdated = True
        super().__init__(context=context)
        self._held = ExitStack()
        self._due, self._ring = 0.0, None  # of the alarm, None without one
        self._quiet = _QUIET  # longest wait for a sample

    def wake(self):
        """Note that an entity was created, destroyed or changed, or that the context is shut down."""
        self._outdated = True
        super().wake()

    def add_node(self, node):
        """Add a node to be served."""
        self._outdated = True
        return super().add_node(node)

    def remove_node(self, node):
        """Stop serving `node`."""
        self._outdated = True
        super().remove_node(node)

    def set_alarm(self, due, ring):
        """Call `ring()` once at `due` [s, monotonic], instead of what was set before; called in a callback."""
        self._due, self._ring, self._quiet = due, ring, 0

    def spin(self):
        """Serve all nodes until the context is shut down."""
        with self._held:
            events_at = perf_counter() + _EVENTS_EVERY
            while self._context.ok():
                if self._outdated:
                    self._gather()
                self._serve(self._all, round(1e9 * _EVENTS_EVERY) if self._ring is None else 0)
                self._run_flow()
                if perf_counter() > events_at:
                    self._serve(self._events, 0)
                    events_at = perf_counter() + _EVENTS_EVERY

    def _gather(self):
        """Collect all entities and hold them: another thread may destroy one while it is waited for."""
        self._outdated = False
        self._held.close()
        self._held.enter_context(self._context.handle)
        nodes = self.get_nodes()
        subscriptions = [s for node in nodes for s in node.subscriptions]
        hot = [s for s in subscriptions if isinstance(s.callback_group, HotGroup)]
        patient = [s for s in subscriptions if isinstance(s.callback_group, PatientGroup)]
        flow = {s.handle.pointer for s in (*hot, *patient)}
        rest = {
            'timer': [(timer, self._take_timer) for node in nodes for timer in node.timers],
            'subscription': [(s, self._take_subscription) for s in subscriptions if s.handle.pointer not in flow],
            'guard_condition': [(guard, self._take_guard_condition) for node in nodes for guard in node.guards],
            'client': [(client, self._take_client) for node in nodes for client in node.clients],
            'service': [(service, self._take_service) for node in nodes for service in node.services],
        }
        waitables = [(waitable, self._take_waitable) for node in nodes for waitable in node.waitables]
        events = [pair for pair in waitables if isinstance(pair[0], EventHandler)]
        others = [pair for pair in waitables if not isinstance(pair[0], EventHandler)]
        for entity in (*hot, *patient, *(entity for kind in rest.values() for entity, _ in kind)):
            self._held.enter_context(entity.handle)
        for waitable, _ in waitables:
            self._held.enter_context(waitable)
        wakers = [self._guard.handle, self._sigint_gc.handle]
        self._rest = Waiting(self._context, rest, others)
        self._all = Waiting(self._context, rest, others, wakers, [s.handle for s in (*hot, *patient)])
        self._events = Waiting(self._context, {}, events)
        self._hot = [s.handle for s in hot]
        self._takes = {s.handle.pointer: _TickTaker(s) for s in hot}
        self._hot_wait_set = _rclpy.WaitSet(len(hot), 0, 0, 0, 0, 0, self._context.handle)
        self._queues = _Queues(patient)

    def _run_flow(self):
        """Serve the tick until no message has arrived for `_QUIET` and no alarm is set."""
        handles, takes, wait_set = self._hot, self._takes, self._hot_wait_set
        timeout = 0  # another entity may have ended the waiting
        empty_at = 0.0
        serve_at = perf_counter() + _SERVE_EVERY
        while not self._outdated and self._context.ok():
            ready = found = ()
            if handles:
                wait_set.clear_entities()
                for handle in handles:
                    wait_set.add_subscription(handle)
                wait_set.wait(timeout)
                ready = wait_set.get_ready_entities('subscription')
                for pointer in ready:
                    take = takes[pointer]
                    result = take_one(take.record)
                    if result > 0:
                        data = take.content.tobytes()
                        for serve in take.served:
                            serve(data)
                    elif result < 0:
                        take.on_other(result)
            elif timeout:
                sleep(_EMPTY_EVERY)
            now = perf_counter()
            if now > empty_at or (not ready and self._ring is None):
                found = self._queues.empty()
                empty_at = now + _EMPTY_EVERY
            if not ready and not found:
                if self._ring is None:
                    return
                self._approach_alarm()
            timeout = self._quiet
            if now > serve_at:
                self._serve(self._rest, 0)
                end = perf_counter()
                serve_at = end + max(_SERVE_EVERY, (end - now) / _SERVE_SHARE)

    def _approach_alarm(self):
        """Wait for the alarm and ring it; return earlier for a sample, or to empty the queues."""
        sleeping = self._due - monotonic() - _SPIN
        if sleeping > 0:
            wait_set = self._hot_wait_set
            wait_set.clear_entities()
            for handle in self._hot:
                wait_set.add_subscription(handle)
            wait_set.wait(round(1e9 * min(sleeping, _EMPTY_EVERY)))  # fails without a subscription; a machine has some
            return
        due, ring, self._ring, self._quiet = self._due, self._ring, None, _QUIET
        while monotonic() < due:
            pass
        ring()

    def _serve(self, waiting, timeout):
        """Wait for up to `timeout` [ns] and serve the ready entities once each."""
        ready = waiting.wait(timeout)
        with self._tasks_lock:
            self._tasks += [(Task(_execute, pair, executor=self), None, None) for pair in ready]
        self._run_tasks()

    def _run_tasks(self):
        """Run tasks, and those they create, until none of them makes progress."""
        done = True
        while done:
            with self._tasks_lock:
                tasks, self._tasks = self._tasks, []
            done, pending = False, []
            for entry in tasks:
                task = entry[0]
                task()
                if task.done():
                    done = True
                    task.result()  # raises the exception of the callback
                elif not task.cancelled():
                    pending.append(entry)
            with self._tasks_lock:
                self._tasks[:0] = pending


class _TickTaker(TickTake):
    """The take of a subscription of the servo tick, with everything it needs, so that nothing is looked up."""

    def __init__(self, subscription):
        tick = subscription.callback_group.subscriptions[subscription]
        super().__init__(subscription.handle.pointer, tick.size)
        self.served = tick.served
        self._on = {MALFORMED: tick.on_malformed, STRANGER: tick.on_stranger}
        tick.take_by(self)

    def on_other(self, result):
        """Handle a result of `take_one` that is no message to be served."""
        self._on.get(result, self.raise_error)()


class _Queues:
    """The queues of patient subscriptions."""

    def __init__(self, subscriptions):
        self._taker = Taker()
        callbacks = [(each.handle.pointer, each.callback) for each in subscriptions]
        self._callbacks = [(*pair, getattr(pair[1], 'denials', NONE)) for pair in callbacks]
        self._groups = {subscription.callback_group for subscription in subscriptions}

    def empty(self):
        """Pass the waiting messages to the callbacks; return whether there were any."""
        found = 0
        for pointer, callback, denials in self._callbacks:
            found += self._taker.take(pointer, callback, _EMPTY_AT_MOST, denials)
        for group in self._groups:
            group.emptied()
        return found > 0


async def _execute(entity, take):
    """Call the callback of `entity` with what `take` takes, unless a callback of its group is suspended."""
    if not entity.callback_group.beginning_execution(entity):
        sleep(_SUSPENDED)
        return
    try:
        call = take(entity)
        if call is not None:
            await call()
    except (ValueError, OverflowError) as error:
        # a message may be unreadable: rclpy raises for a negative time on /clock, and for text that is no UTF-8
        if not isinstance(entity, Subscription) or isinstance(error, PkmError):
            raise
        _log_dropped(f'{entity.topic_name}: message dropped: {error}')
    finally:
        entity.callback_group.ending_execution(entity)
