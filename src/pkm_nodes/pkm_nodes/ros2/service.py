"""`ros2 service call`."""

import sys
import time

from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.ros2.messages import make_message, parse_yaml
from pkm_nodes.ros2.shared import FIND_TIMEOUT, NODE_PREFIX, add_commands, ros_node, spin_until_done


def add_arguments(parser):
    """Add the verbs of `ros2 service`."""
    parser.add_argument('--include-hidden-services', action='store_true', help='Consider hidden services as well')
    verb = add_commands(parser, {'call': 'Call a service'})['call']
    verb.set_defaults(main=call)
    verb.add_argument('service_name', help="Name of the ROS service to call to (e.g. '/add_two_ints')")
    verb.add_argument('service_type', help="Type of the ROS service (e.g. 'std_srvs/srv/Empty')")
    values = verb.add_mutually_exclusive_group()
    values.add_argument(
        'values',
        nargs='?',
        default='{}',
        help="Values to fill the service request with in YAML format (e.g. '{a: 1, b: 2}'), "
        'otherwise the service request will be published with default values',
    )
    values.add_argument('--stdin', action='store_true', help='Read values from standard input')
    verb.add_argument('-r', '--rate', metavar='N', type=float, help='Repeat the call at a specific rate in Hz')


def call(args):
    """Call the service once, or at a rate until Ctrl-C, and print each response."""
    if args.rate is not None and args.rate <= 0:
        return 'rate must be greater than zero'
    service = find_interface(args.service_type, 'srv')
    values = parse_yaml(sys.stdin.read() if args.stdin else args.values)
    try:
        request = make_message(service.Request, values)
    except Exception as error:  # the message of any converter; the user corrects the value
        return f'Failed to populate field: {error}'
    package, *_, name = args.service_type.split('/')
    with ros_node(f'{NODE_PREFIX}_requester_{package}_{name}') as node:
        client = node.create_client(service, args.service_name)
        if not client.service_is_ready():
            print('waiting for service to become available...')
            if not client.wait_for_service(FIND_TIMEOUT):
                return f"No service '{args.service_name}' of type '{args.service_type}' within {FIND_TIMEOUT} s"

        def check():
            if not client.service_is_ready():
                raise RuntimeError(f"The service '{args.service_name}' has left the graph without an answer")

        while True:
            called = time.monotonic()
            print(f'requester: making request: {request!r}\n')
            print(f'response:\n{spin_until_done(node, client.call_async(request), check=check)!r}\n')
            if args.rate is None:
                return None
            time.sleep(max(0.0, called + 1 / args.rate - time.monotonic()))
