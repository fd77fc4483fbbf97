"""A wait set that is filled repeatedly with the same entities; it uses parts of rclpy as lockstep.py does."""

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.waitable import NumberOfEntities

# entities of a wait set, in the order of the constructor of `WaitSet`
_KINDS = ('subscription', 'guard_condition', 'timer', 'client', 'service')


class Waiting:
    """
    A wait set that is filled repeatedly with the same entities.

    Parameters
    ----------
    context : Context
    entities : dict of str to list
        (entity, function that takes from it) by kind.
    waitables : list
        (waitable, function that takes from it): actions and events.
    guards, subscriptions : list
        Handles that only end the waiting.

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
        """Wait for up to `timeout` [ns]; return (entity, function that takes from it) of the ready ones."""
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
            # rcl reports cancelled timers as ready
            ready += [pair for pair in found if kind != 'timer' or pair[0].handle.is_timer_ready()]
        return ready
