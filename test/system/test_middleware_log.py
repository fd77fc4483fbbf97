"""What Fast DDS reports goes to stderr: the output of a program is its own."""

import sys

DOMAIN = 123
SCRIPT = "import pkm_nodes, rclpy; rclpy.init(); rclpy.create_node('some'); print('own')"


def test_report_of_the_middleware_is_not_in_the_output(processes):
    """The address is none; by default the report is the first line of the output."""
    processes.environment['ROS_DISCOVERY_SERVER'] = ':::x'
    done = processes.run(sys.executable, '-c', SCRIPT)
    assert done.returncode == 0, done.stderr
    assert done.stdout == 'own\n'
    assert 'Wrong locator' in done.stderr
