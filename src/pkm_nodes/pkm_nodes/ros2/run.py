"""`ros2 run`."""

import argparse
import os
import shlex
import signal

from ament_index_python import PackageNotFoundError, get_package_prefix


def add_arguments(parser):
    """Add the arguments of `ros2 run`."""
    parser.set_defaults(main=run)
    parser.add_argument(
        '--prefix',
        help='Prefix command, which should go before the executable. Command must be wrapped in quotes '
        "if it contains spaces (e.g. --prefix 'gdb -ex run --args').",
    )
    parser.add_argument('package_name', help='Name of the ROS package')
    parser.add_argument('executable_name', help='Name of the executable')
    parser.add_argument('argv', nargs=argparse.REMAINDER, help='Pass arbitrary arguments to the executable')


def find_executables(package, executable):
    """Return the paths of the executables of this name below lib/package."""
    try:
        prefix = get_package_prefix(package)
    except (PackageNotFoundError, ValueError):
        raise RuntimeError(f"Package '{package}' not found") from None
    paths = (
        os.path.join(folder, executable)
        for folder, _, files in os.walk(os.path.join(prefix, 'lib', package))
        if executable in files
    )
    return sorted(path for path in paths if os.access(path, os.X_OK))


def run(args):
    """Replace this process by the executable, which gets its signals and sets its exit status."""
    paths = find_executables(args.package_name, args.executable_name)
    if not paths:
        return 'No executable found'
    if len(paths) > 1:
        return '\n- '.join(['Multiple executables found:', *paths])
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Python ignores it, and exec would keep that
    command = [*shlex.split(args.prefix or ''), paths[0], *args.argv]
    return os.execvp(command[0], command)
