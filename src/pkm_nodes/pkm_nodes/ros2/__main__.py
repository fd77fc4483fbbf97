"""`ros2` for a computer without ROS: the verbs used with this cell, with arguments and output of ros2cli (Jazzy)."""

import argparse
import importlib
import os
import sys

from pkm_core.errors import PkmError
from pkm_core.interrupts import Interrupted, interruptible
from pkm_core.start import prepare
from pkm_nodes.ros2.shared import add_commands
from pkm_nodes.ros2.substitute import Parser, missing
from pkm_nodes.runtime.environment import check_ros_environment

COMMANDS = {  # each is a module of this package with add_arguments(parser)
    'action': 'Various action related sub-commands',
    'bag': 'Various rosbag related sub-commands',
    'doctor': 'Check ROS setup and other potential issues',
    'interface': 'Show information about ROS interfaces',
    'node': 'Various node related sub-commands',
    'param': 'Various param related sub-commands',
    'run': 'Run a package specific executable',
    'service': 'Various service related sub-commands',
    'topic': 'Various topic related sub-commands',
}


def make_parser(argv):
    """Return the parser with the arguments of the command in `argv`; other commands are not imported."""
    parser = Parser(
        prog='ros2',
        description='A substitute for a part of ros2, the command-line tool of ROS 2, on a computer without ROS.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        '--use-python-default-buffering',
        action='store_true',
        help='Do not force line buffering in stdout and instead use the python default buffering',
    )
    parsers = add_commands(parser, COMMANDS)
    selected = next((arg for arg in argv if not arg.startswith('-')), None)
    if selected in COMMANDS:
        importlib.import_module(f'pkm_nodes.ros2.{selected}').add_arguments(parsers[selected])
    return parser


def main(argv):
    """Run one command line; return its exit status, or the text of the error that ended it."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    if sys.prefix not in prefixes:  # no setup file is sourced here
        os.environ['AMENT_PREFIX_PATH'] = os.pathsep.join(filter(None, [*prefixes, sys.prefix]))
    try:
        prepare()
        check_ros_environment()
        if text := missing(argv):
            print(text, file=sys.stderr)
            return 2
        args = make_parser(argv).parse_args(argv)
        if not args.use_python_default_buffering:
            sys.stdout.reconfigure(line_buffering=True)
        with interruptible():
            return args.main(args)
    except Interrupted as interrupted:
        return interrupted.code
    except BrokenPipeError:  # the reader of the pipe, such as head, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (RuntimeError, OSError, PkmError) as error:
        return str(error)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
