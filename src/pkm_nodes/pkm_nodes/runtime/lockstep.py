"""
The executor of the servo tick.

A tick is a chain of short callbacks: encoder samples wake the controllers, their commands wake the machine. rclpy's
executors look at every service, timer, parameter and event of every node, in Python, for each of them: 0.3 ms a
callback for one node, several for a composed cell. Three things make the difference here:

- The subscriptions of the tick, those in a `HotGroup`, have a wait set of their own. While samples flow only that one
  is waited on, and what is taken goes straight to the callback: no task, no lock, nothing looked up.
- Whoever only listens to the tick, as a recorder does, need not be woken by it: subscriptions in a `PatientGroup` are
  not waited on but emptied every `_EMPTY_EVERY`, many messages at a time (queues.py).
- What a wait set must hold is gathered once and again only when an entity has come or gone, so that a look at all the
  rest costs microseconds. It is taken every `_SERVE_EVERY` while samples flow, so parameters, services and timers are
  served without being waited for. Where nothing flows the executor sleeps until something happens.

Quality-of-service events, of which every publisher and subscription has two, are half of all there is to look at and
hardly ever happen: they are looked at every `_EVENTS_EVERY`.

Only what rclpy's own executors call is used of rclpy, but much of that is not public: the version is pinned.
"""

import gc
from contextlib import ExitStack
from time import perf_counter, sleep

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.executors import Executor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities

from pkm_nodes.runtime.queues import Taker

# [s] how often all the rest gets a turn while ticks flow, and the most of the time that such turns may take: on a
# computer that is short of time a turn takes long, and the next one comes later
_SERVE_EVERY = 0.05
_SERVE_SHARE = 0.05
# [ns] silence after which all the rest is waited for as well
_QUIET = 300_000
# [s] how often patient subscriptions are emptied: some 200 ticks of the thousand they hold
_EMPTY_EVERY = 0.02
# messages taken from one of them at a time, so that a fast publisher cannot keep the others waiting
_EMPTY_AT_MOST = 1000
# [s] how often quality-of-service events are looked at, and the longest sleep
_EVENTS_EVERY = 1.0
# [s] pause where a callback is due in a group of which another one awaits something
_SUSPENDED = 0.001
# what a wait set holds, in the order rclpy counts it
_KINDS = ('subscription', 'guard_condition', 'timer', 'client', 'service')


class HotGroup(ReentrantCallbackGroup):
    """Subscriptions of the servo tick; in another executor they are like any other."""


class PatientGroup(ReentrantCallbackGroup):
    """
    Raw subscriptions whose messages may wait while ticks flow.

    Their callbacks get the bytes of one message, or several messages of equal size as the rows of an array of bytes;
    `emptied()` is called after every turn.
    """

    def __init__(self, emptied):
        super().__init__()
        self.emptied = emptied

    def ending_execution(self, entity):
        """Note that another executor has served a message."""
        self.emptied()


class LockstepExecutor(Executor):
    """A single-threaded executor with a fast lane for the subscriptions in `HotGroup`s."""

    def __init__(self, *, context=None):
        self._outdated = True
        super().__init__(context=context)
        self._held = ExitStack()

    def wake(self):
        """Note that an entity has come or gone, or that the context is shut down."""
        self._outdated = True
        super().wake()

    def add_node(self, node):
        """Serve `node` too."""
        self._outdated = True
        return super().add_node(node)

    def remove_node(self, node):
        """Serve `node` no longer."""
        self._outdated = True
        super().remove_node(node)

    def run(self):
        """Serve all nodes until the context is shut down."""
        with self._held:
            events_at = perf_counter() + _EVENTS_EVERY
            while self._context.ok():
                if self._outdated:
                    self._gather()
                self._serve(self._all, round(1e9 * _EVENTS_EVERY))
                self._run_flow()
                if perf_counter() > events_at:
                    self._serve(self._events, 0)
                    events_at = perf_counter() + _EVENTS_EVERY

    def _gather(self):
        """Look up all there is to wait for, and hold it: what is destroyed by another thread may be waited for now."""
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
        self._rest = _Waiting(self._context, rest, others)
        self._all = _Waiting(self._context, rest, others, wakers, [s.handle for s in (*hot, *patient)])
        self._events = _Waiting(self._context, {}, events)
        self._hot = [s.handle for s in hot]
        self._takes = {s.handle.pointer: _take_of(s) for s in hot}
        self._hot_wait_set = _rclpy.WaitSet(len(hot), 0, 0, 0, 0, 0, self._context.handle)
        self._queues = _Queues(patient)

    def _run_flow(self):
        """Serve the tick until nothing has come for `_QUIET`."""
        handles, takes, wait_set = self._hot, self._takes, self._hot_wait_set
        timeout = 0  # perhaps it was not the tick that woke the executor
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
                    take_message, message_type, raw, callback = takes[pointer]
                    taken = take_message(message_type, raw)
                    if taken is not None:
                        callback(taken[0])
            elif timeout:
                sleep(_EMPTY_EVERY)
            now = perf_counter()
            if not ready or now > empty_at:
                found = self._queues.empty()
                empty_at = now + _EMPTY_EVERY
            if not ready and not found:
                return
            timeout = _QUIET
            if now > serve_at:
                self._serve(self._rest, 0)
                end = perf_counter()
                serve_at = end + max(_SERVE_EVERY, (end - now) / _SERVE_SHARE)

    def _serve(self, waiting, timeout):
        """Wait for up to `timeout` [ns] and serve who is ready then, each once."""
        ready = waiting.wait(timeout)
        with self._tasks_lock:
            self._tasks += [(Task(_execute, pair, executor=self), None, None) for pair in ready]
        self._run_tasks()

    def _run_tasks(self):
        """Run what was begun as long as something gets done: callbacks, coroutines, and what futures call then."""
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
                    task.result()  # raises what the callback has raised
                elif not task.cancelled():
                    pending.append(entry)
            with self._tasks_lock:
                self._tasks[:0] = pending


class _Waiting:
    """
    A wait set that is filled again and again with the same entities.

    Parameters
    ----------
    context : Context
    entities : dict of str to list
        (entity, how to take from it) by their kind.
    waitables : list
        (waitable, how to take from it): actions and events.
    guards, subscriptions : list
        Handles of what only ends the waiting.

    """

    def __init__(self, context, entities, waitables, guards=(), subscriptions=()):
        handles = {kind: [entity.handle for entity, _ in of_kind] for kind, of_kind in entities.items()}
        handles['guard_condition'] = [*handles.get('guard_condition', ()), *guards]
        handles['subscription'] = [*handles.get('subscription', ()), *subscriptions]
        count = NumberOfEntities(*(len(handles.get(kind, ())) for kind in _KINDS))
        for waitable, _ in waitables:
            count += waitable.get_num_entities()
        self._wait_set = _rclpy.WaitSet(*(getattr(count, name) for name in count.__slots__), context.handle)
        self._fill = [(getattr(self._wait_set, f'add_{kind}'), handle) for kind in handles for handle in handles[kind]]
        self._entities = {kind: {pair[0].handle.pointer: pair for pair in entities[kind]} for kind in entities}
        self._waitables = waitables

    def wait(self, timeout):
        """Wait for up to `timeout` [ns]; return (entity, how to take from it) of those that are ready."""
        wait_set = self._wait_set
        wait_set.clear_entities()
        for add, handle in self._fill:
            add(handle)
        for waitable, _ in self._waitables:
            waitable.add_to_wait_set(wait_set)
        wait_set.wait(timeout)
        ready = [pair for pair in self._waitables if pair[0].is_ready(wait_set)]
        for kind, entities in self._entities.items():
            found = [entities[pointer] for pointer in wait_set.get_ready_entities(kind) if pointer in entities]
            # rcl shows timers that were cancelled as ready
            ready += [pair for pair in found if kind != 'timer' or pair[0].handle.is_timer_ready()]
        return ready


class _Queues:
    """The queues of patient subscriptions."""

    def __init__(self, subscriptions):
        self._taker = Taker()
        self._callbacks = [(subscription.handle.pointer, subscription.callback) for subscription in subscriptions]
        self._groups = {subscription.callback_group for subscription in subscriptions}

    def empty(self):
        """Hand over what waits; tell whether there was anything."""
        found = 0
        for pointer, callback in self._callbacks:
            found += self._taker.take(pointer, callback, _EMPTY_AT_MOST)
        for group in self._groups:
            group.emptied()
        return found > 0


async def _execute(entity, take):
    """Call the callback of `entity` with what `take` takes from it, unless another one of its group is suspended."""
    if not entity.callback_group.beginning_execution(entity):
        sleep(_SUSPENDED)
        return
    try:
        call = take(entity)
        if call is not None:
            await call()
    finally:
        entity.callback_group.ending_execution(entity)


def _take_of(subscription):
    """Return what it takes to serve `subscription`, looked up once and not with every message."""
    return subscription.handle.take_message, subscription.msg_type, subscription.raw, subscription.callback


def spin(nodes):
    """Serve `nodes` in one lock-step executor until the context is shut down."""
    executor = LockstepExecutor(context=rclpy.get_default_context())
    for node in nodes:
        executor.add_node(node)
    # what is there now stays: a garbage collection that walks through all of it takes 0.1 s
    gc.collect()
    gc.freeze()
    executor.run()
