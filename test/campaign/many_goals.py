"""Goals of many clients at once: `python -m campaign.many_goals CLIENTS GOALS`."""

import sys
from time import monotonic

import rclpy
from rclpy.action import ActionClient

from pkm_interfaces.action import ExecuteMotion
from pkm_nodes.runtime.node import REQUEST_QOS

# the default depth of 10 loses requests and answers in the queues of these clients themselves
_DEEP = {f'{kind}_service_qos_profile': REQUEST_QOS for kind in ('goal', 'result')}
_GOAL = ExecuteMotion.Goal(motion='four_dof_70ms', cycles=1, learning_law='none')


def main(clients, goals):
    """Send `goals` goals from each of `clients` clients before reading an answer; exit with 1 if one has no result."""
    rclpy.init()
    node = rclpy.create_node('many')
    each = [ActionClient(node, ExecuteMotion, '/pkm/execute_motion', **_DEEP) for _ in range(clients)]
    for client in each:
        client.wait_for_server(timeout_sec=90.0)
    sent = [client.send_goal_async(_GOAL) for _ in range(goals) for client in each]
    results, last = [], monotonic()
    while monotonic() - last < 25.0 and len(results) < len(sent):
        rclpy.spin_once(node, timeout_sec=0.1)
        handles = [future.result() for future in sent if future.done()]
        known = {id(handle) for handle, _ in results}
        for handle in handles:
            if id(handle) not in known:
                results.append((handle, handle.get_result_async() if handle.accepted else None))
                last = monotonic()
    waiting = [result for _, result in results if result is not None]
    while monotonic() - last < 25.0 and not all(result.done() for result in waiting):
        before = sum(result.done() for result in waiting)
        rclpy.spin_once(node, timeout_sec=0.1)
        if sum(result.done() for result in waiting) > before:
            last = monotonic()
    done = sum(result is None or result.done() for _, result in results)
    print(f'{done} of {len(sent)} goals answered', flush=True)
    sys.exit(done < len(sent))


main(int(sys.argv[1]), int(sys.argv[2]))
