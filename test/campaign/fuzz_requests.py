"""Random goals, service requests and parameters for a running cell: `python -m campaign.fuzz_requests SEED COUNT`."""

import sys
from collections import Counter
from random import Random
from time import monotonic

import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters
from rclpy.action import ActionClient
from std_srvs.srv import Trigger

from campaign.random_messages import random_message, random_value
from pkm_interfaces.action import ExecuteMotion, Identify
from pkm_nodes.messages.interfaces import find_interface

ANSWER = 25.0
_VALUES = {
    ParameterType.PARAMETER_BOOL: ('bool_value', 'boolean'),
    ParameterType.PARAMETER_INTEGER: ('integer_value', 'int64'),
    ParameterType.PARAMETER_DOUBLE: ('double_value', 'double'),
    ParameterType.PARAMETER_STRING: ('string_value', 'string'),
}


class Fuzz:
    """A client that asks at random and counts what is not answered."""

    def __init__(self, seed):
        self.draw = Random(seed)
        self.node = rclpy.create_node('fuzz')
        self.unanswered = []
        self.answered = Counter()

    def answer(self, future, what):
        """Return the result of `future`; note `what` if there is none in time."""
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=ANSWER)
        if not future.done():
            self.unanswered.append(what)
            return None
        self.answered[what.split()[0]] += 1
        return future.result()

    def goal(self, action_type, name):
        """Send a random goal, cancel it after a moment if it is accepted, and wait for its result."""
        client = ActionClient(self.node, action_type, name)
        if not client.wait_for_server(timeout_sec=ANSWER):
            self.unanswered.append(f'{name}: no server')
            return
        goal = random_message(
            self.draw, action_type.Goal, session='', motion='four_dof_70ms', cycles=1, learning_law='none', poses=[],
            learned='', controller='', experiment=action_type.Goal().experiment, excitation=[], move_time=0.0,
        ) if action_type is ExecuteMotion else random_message(self.draw, action_type.Goal)  # fmt: skip
        handle = self.answer(client.send_goal_async(goal), f'goal of {name}')
        if handle and handle.accepted:
            result = handle.get_result_async()
            end = monotonic() + self.draw.uniform(0.0, 3.0)
            while not result.done() and monotonic() < end:
                rclpy.spin_once(self.node, timeout_sec=0.05)
            if not result.done():
                self.answer(handle.cancel_goal_async(), f'cancel of {name}')
            self.answer(result, f'result of {name}')
        client.destroy()

    def service(self, name, type_name):
        """Send a random request."""
        service_type = find_interface(type_name, 'srv')
        client = self.node.create_client(service_type, name)
        if client.wait_for_service(timeout_sec=ANSWER):
            self.answer(
                client.call_async(random_message(self.draw, service_type.Request, session='')), f'request of {name}'
            )
        else:
            self.unanswered.append(f'{name}: no server')
        self.node.destroy_client(client)

    def parameter(self, node):
        """Set a declared parameter of `node` to a random value of a random type."""
        listing = self.node.create_client(ListParameters, f'{node}/list_parameters')
        setting = self.node.create_client(SetParameters, f'{node}/set_parameters')
        if listing.wait_for_service(timeout_sec=ANSWER) and setting.wait_for_service(timeout_sec=ANSWER):
            names = self.answer(listing.call_async(ListParameters.Request()), f'list_parameters of {node}')
            kind = self.draw.choice(list(_VALUES))
            field, type_name = _VALUES[kind]
            value = ParameterValue(type=kind, **{field: random_value(self.draw, type_name)})
            name = self.draw.choice(names.result.names if names else ['gone'])
            request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
            self.answer(setting.call_async(request), f'set_parameters of {node}: {name}')
        else:
            self.unanswered.append(f'{node}: no parameter services')
        self.node.destroy_client(listing)
        self.node.destroy_client(setting)

    def round(self):
        """Ask one thing."""
        way = self.draw.randrange(4)
        if way == 0:
            self.goal(ExecuteMotion, '/pkm/execute_motion')
        elif way == 1:
            self.goal(Identify, '/pkm/identify')
        elif way == 2:
            services = [each for each in self.node.get_service_names_and_types() if each[0].startswith('/pkm/')]
            services = [each for each in services if '/_action/' not in each[0] and 'rcl_interfaces' not in each[1][0]]
            if services:
                name, types = self.draw.choice(sorted(services))
                self.service(name, types[0])
        else:
            nodes = [f'{space}/{name}' for name, space in self.node.get_node_names_and_namespaces() if space == '/pkm']
            if nodes:
                self.parameter(self.draw.choice(sorted(nodes)))


def main(seed, count):
    """Ask `count` times; then the machine must be resettable; print what was not answered and exit with 1."""
    rclpy.init()
    fuzz = Fuzz(seed)
    ActionClient(fuzz.node, ExecuteMotion, '/pkm/execute_motion').wait_for_server(timeout_sec=90.0)
    for _ in range(count):
        fuzz.round()
    client = fuzz.node.create_client(Trigger, '/pkm/machine/reset')
    fuzz.answer(client.call_async(Trigger.Request()), 'machine/reset at the end')
    print('answered:', ', '.join(f'{count} {what}' for what, count in sorted(fuzz.answered.items())), flush=True)
    print('unanswered:', fuzz.unanswered or 'none', flush=True)
    sys.exit(bool(fuzz.unanswered))


main(int(sys.argv[1]), int(sys.argv[2]))
