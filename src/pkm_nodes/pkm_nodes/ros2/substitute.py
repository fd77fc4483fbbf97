"""The commands of ros2cli that this substitute lacks: each gets one line with its purpose, instead of a wrong guess."""

import argparse

# {command: (purpose, {verb: purpose})} of ros2cli 0.32 (Jazzy) and rosbag2 0.26; an empty purpose: the command is here
MISSING = {
    'action': ('', {}),
    'bag': (
        '',
        {
            'burst': 'Burst data from a bag',
            'convert': 'Given an input bag, write out a new bag with different settings',
            'list': 'Print information about available plugins to the screen',
            'play': 'Play back ROS data from a bag; here: pkm bag-play',
            'reindex': 'Reconstruct metadata file for a bag; here: pkm bag-doctor',
        },
    ),
    'component': ('Various component related sub-commands', {}),
    'control': ('Various control related sub-commands', {}),
    'daemon': ('Various daemon related sub-commands; this substitute has no daemon', {}),
    'extension_points': ('List extension points', {}),
    'extensions': ('List extensions', {}),
    'interface': (
        '',
        {
            'list': 'List all interface types available',
            'package': 'Output a list of available interface types within one package',
            'packages': 'Output a list of packages that provide interfaces',
            'proto': 'Output an interface prototype',
        },
    ),
    'launch': ('Run a launch file; here: pkm run, or ros2 run pkm_nodes cell', {}),
    'lifecycle': ('Various lifecycle related sub-commands', {}),
    'multicast': ('Various multicast related sub-commands', {}),
    'param': ('', {'delete': 'Delete parameter'}),
    'pkg': ('Various package related sub-commands', {}),
    'security': ('Various security related sub-commands', {}),
    'service': (
        '',
        {'echo': 'Echo a service', 'find': 'Output a list of available services of a given type'},
    ),
    'topic': ('', {'find': 'Output a list of available topics of a given type'}),
    'wtf': ('Use `wtf` as alias to `doctor`', {}),
}
NOTE = (
    'This is bringup_scripts/ros2, the substitute for a computer without ROS. It has a part of the commands; the ros2 '
    'of a ROS 2 Jazzy installation has all, and takes over when it is on PATH.'
)


def missing(argv):
    """Return the text about the command in `argv` if ros2cli has it and this substitute does not, else ''."""
    words = [word for word in argv if not word.startswith('-')][:2]
    if not words or words[0] not in MISSING:
        return ''
    purpose, verbs = MISSING[words[0]]
    if not purpose:
        purpose = verbs.get(words[1], '') if len(words) > 1 else ''
    else:
        words = words[:1]
    return f'ros2 {" ".join(words)}: not in this substitute; the real one: {purpose}.\n{NOTE}' if purpose else ''


class Parser(argparse.ArgumentParser):
    """A parser that adds to the refusal of an unknown command that this is not the real ros2."""

    def error(self, message):
        """Print usage and refusal, and exit with code 2."""
        note = f'\n{NOTE}' if 'invalid choice' in message and 'Call `' in message else ''
        self.exit(2, f'{self.format_usage()}{self.prog}: error: {message}{note}\n')
