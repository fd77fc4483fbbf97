"""Environment variables of ROS, checked before rclpy reads them: its own refusals are silent or several lines long."""

import os
import re
import sys
from pathlib import Path

from pkm_core.errors import PkmError

# the UDP ports of higher domains are above 65535
_HIGHEST_DOMAIN = 232
_SHARED_MEMORY = '/dev/shm'
# [bytes] the tracing library of ROS writes one page per process
_LEAST_MEMORY = 16384


def check_ros_environment():
    """
    Raise `PkmError` if this installation cannot work with the environment.

    Checked are ROS_DOMAIN_ID, RMW_IMPLEMENTATION and the space in /dev/shm. With little space there Fast DDS sends over
    UDP; without any, the import of rclpy ends the process with a bus error.
    """
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    if not re.fullmatch(r'\d{1,3}', domain, re.ASCII) or int(domain) > _HIGHEST_DOMAIN:
        raise PkmError(f'ROS_DOMAIN_ID: {domain[:40]!r} given; expected an integer, 0 to {_HIGHEST_DOMAIN}')
    if os.path.isdir(_SHARED_MEMORY):
        status = os.statvfs(_SHARED_MEMORY)
        free = status.f_bavail * status.f_frsize
        if free < _LEAST_MEMORY:
            raise PkmError(
                f'{_SHARED_MEMORY}: {free // 1024} KiB free; expected at least {_LEAST_MEMORY // 1024} KiB. '
                'Delete files there, or enlarge it (docker: --shm-size)'
            )
    middleware = os.environ.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp'
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)), sys.prefix]
    folders = [Path(prefix) / 'share/ament_index/resource_index/rmw_typesupport' for prefix in prefixes]
    installed = {path.name for folder in folders if folder.is_dir() for path in folder.iterdir()} - {
        'rmw_implementation'
    }
    if installed and middleware not in installed:
        raise PkmError(f'RMW_IMPLEMENTATION: {middleware[:80]!r} is not installed; installed: {sorted(installed)}')
