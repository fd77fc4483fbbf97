"""What Fast DDS reports goes to stderr: the output of a program is its own."""

import fcntl
import sys
from pathlib import Path

DOMAIN = 123
PKM = Path(sys.prefix) / 'bin' / 'pkm'
SCRIPT = "import pkm_nodes, rclpy; rclpy.init(); rclpy.create_node('some'); print('own')"
# Fast DDS tries the ports of shared memory from this one on
FIRST_PORT = Path('/dev/shm/fastrtps_port7000_el')


def test_report_of_the_middleware_is_not_in_the_output(processes):
    """Another process looks at a port at the same moment, which occurs about once in a thousand starts."""
    with FIRST_PORT.open('a') as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        done = processes.run(sys.executable, '-c', SCRIPT)
    assert done.returncode == 0, done.stderr
    assert done.stdout == 'own\n'
    assert 'RTPS_TRANSPORT_SHM' in done.stderr
