"""`ros2 interface show` and the commands that the substitute lacks; the texts are those of ros2cli 0.32 (Jazzy)."""

import re

import pytest

from pkm_nodes.ros2.__main__ import COMMANDS, make_parser
from pkm_nodes.ros2.interface import definition
from pkm_nodes.ros2.substitute import MISSING, missing
from support.ros2_tool import ros2


def test_nested_messages_are_indented_below_their_field():
    assert definition('std_msgs/msg/Header', with_comments=False) == [
        'builtin_interfaces/Time stamp',
        '\tint32 sec',
        '\tuint32 nanosec',
        'string frame_id',
    ]
    shown = definition('std_msgs/msg/Header')
    assert '# Two-integer timestamp that is expressed as seconds and nanoseconds.' in shown
    assert '\tuint32 nanosec' in shown
    assert (
        '\t# The nanoseconds component, valid in the range [0, 1e9), to be added to the seconds component. '
        not in shown
    )


def test_actions_and_services_are_shown_with_their_separators():
    goal = definition('pkm_interfaces/action/ExecuteMotion', with_comments=False)
    assert goal.count('---') == 2
    assert any(line.startswith('\tfloat64 x') for line in goal), 'a message of the same package without its name'
    assert definition('std_srvs/srv/SetBool', with_comments=False) == [
        'bool data',
        '---',
        'bool success',
        'string message',
    ]


def test_constants_are_no_fields():
    assert 'byte OK=0' in definition('diagnostic_msgs/msg/DiagnosticStatus', with_comments=False)


@pytest.mark.parametrize(
    ('name', 'refusal'),
    [
        ('std_msgs/Header', "Invalid name 'std_msgs/Header'. Expected three parts separated by '/'"),
        ('std_msgs/msg/Nope', "Could not find the interface 'std_msgs/msg/Nope'"),
        ('../msg/Header', "Could not find the interface '../msg/Header'"),
    ],
)
def test_unknown_interface_is_refused(name, refusal):
    with pytest.raises(RuntimeError) as found:
        ros2('interface', 'show', name)
    assert str(found.value) == refusal


def test_command_of_the_real_ros2_is_named_with_its_purpose():
    text = missing(['topic', '-v', 'find', 'std_msgs/msg/String'])
    assert text.startswith('ros2 topic find: not in this substitute; the real one: Output a list of available topics')
    assert 'here: pkm run' in missing(['launch', 'pkm_nodes', 'cell.launch.py'])
    assert missing(['topic', 'list']) == ''
    assert missing(['nonsense']) == ''
    assert missing([]) == ''


def test_command_is_either_offered_or_named_as_missing():
    for command, (purpose, verbs) in MISSING.items():
        assert bool(purpose) == (command not in COMMANDS), command
        offered = make_parser([command]).format_help() if purpose else _verbs_of(command)
        assert not set(verbs) & set(offered), command


def _verbs_of(command):
    """Return the verbs that the help of `command` lists."""
    text = make_parser([command])._subparsers._group_actions[0].choices[command].format_help()
    return re.findall(r'^  ([a-z_]+)  ', text, re.MULTILINE)


def test_misspelt_command_is_told_that_this_is_a_substitute(capsys):
    with pytest.raises(SystemExit) as left:
        make_parser(['topic', 'lst']).parse_args(['topic', 'lst'])
    assert left.value.code == 2
    said = capsys.readouterr().err
    assert "invalid choice: 'lst'" in said
    assert 'the substitute for a computer without ROS' in said
