"""docs/interfaces.md agrees with the nodes: every topic with its type and QoS, every service and action."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import get_action_names_and_types
from rclpy.parameter import Parameter

from pkm_nodes.graph import cell_nodes
from pkm_nodes.messages.diagnostics import node_of, values_of
from pkm_nodes.messages.interfaces import find_interface
from pkm_nodes.nodes.cell import NODES
from pkm_nodes.nodes.dashboard import DashboardNode
from pkm_nodes.nodes.joint_controller import JointControllerNode
from pkm_nodes.nodes.machine import MachineNode
from pkm_nodes.nodes.recorder import RecorderNode
from pkm_nodes.nodes.state_estimator import StateEstimatorNode
from pkm_nodes.nodes.trajectory_generator import TrajectoryGeneratorNode
from pkm_nodes.parts.follow_joint_trajectory import find_action

ROOT = Path(__file__).parents[2]
LAYOUTS = ROOT / 'src' / 'pkm_nodes' / 'layouts'
# what rclpy gives every node
OF_ROS = re.compile(r'/rosout|/parameter_events|.*/_action/.*|.*/(describe|get|list|set)_(parameter|type_desc).*')


def tables(heading):
    """Return the rows of the table below `heading`, each {column: text}."""
    text = (ROOT / 'docs' / 'interfaces.md').read_text(encoding='utf-8')
    lines = re.split(r'^#+ ', text, flags=re.MULTILINE)
    section = next(part for part in lines if part.startswith(heading + '\n'))
    rows = [[cell.strip() for cell in line.strip('|').split('|')] for line in section.splitlines() if line[:1] == '|']
    return [dict(zip(rows[0], row, strict=True)) for row in rows[2:]]


def for_joints(name, joints):
    return [name.replace('`', '').replace('<joint>', joint) for joint in (joints if '<joint>' in name else joints[:1])]


@pytest.fixture
def documented(machine):
    """Return {topic: (type, reliability, durability, depth)} of the page."""
    profiles = {row['name']: (row['reliability'], row['durability'], int(row['depth'])) for row in tables('QoS')}
    return {
        topic: (row['type'], *profiles[row['QoS']])
        for row in tables('Topics')
        for topic in for_joints(row['topic'], machine.joints)
    }


@pytest.fixture
def nodes(graph, tmp_path):
    """Return all nodes of a cell that learns at the tool, and that of the page."""
    made = [DashboardNode()]
    for spec in cell_nodes('four_dof', folder=tmp_path, learning_target='tool'):
        parameters = [Parameter(name, value=value) for name, value in spec.parameters.items()]
        named = {} if spec.name == spec.executable else {'name': spec.name}
        node = NODES[spec.executable](parameter_overrides=parameters, **named)
        made += [node, *getattr(node, 'parts', [])]
    yield made
    for node in made:
        node.destroy_node()


def type_name(message_type):
    return f'{message_type.__module__.split(".")[0]}/{message_type.__module__.split(".")[1]}/{message_type.__name__}'


def test_every_topic_is_documented_with_its_type_and_qos(nodes, documented):
    offered = {}
    for node in nodes:
        for publisher in node.publishers:
            if not OF_ROS.fullmatch(publisher.topic_name):
                qos = publisher.qos_profile
                profile = (qos.reliability.name.lower(), qos.durability.name.lower(), qos.depth)
                offered[publisher.topic_name] = (type_name(publisher.msg_type), *profile)
    assert offered == documented


def test_topics_are_published_by_the_documented_nodes(nodes, machine):
    """Text after a semicolon is about other controllers, or for people."""
    named = {}
    for row in tables('Topics'):
        sources = [source.strip() for source in row['from'].partition(';')[0].split(',')]
        for topic in for_joints(row['topic'], machine.joints):
            own = [topic.split('/')[2]] if '<joint>' in row['topic'] else machine.joints
            named[topic] = {source.replace('`<joint>`', joint) for source in sources for joint in own}
    said = {topic: set() for topic in named}
    for node in nodes:
        for publisher in node.publishers:
            if not OF_ROS.fullmatch(publisher.topic_name):
                said[publisher.topic_name].add(node.get_name())
    assert said == named


def test_every_subscribed_topic_has_a_publisher(nodes, documented):
    """That of a command topic is a client."""
    commands = {row['topic'].strip('`'): (row['type'],) for row in tables('Command topics')}
    known = documented | commands
    for node in nodes:
        for subscription in node.subscriptions:
            if not OF_ROS.fullmatch(subscription.topic_name):
                assert subscription.topic_name in known, node.get_name()
                assert type_name(subscription.msg_type) == known[subscription.topic_name][0]


def test_every_service_and_action_is_documented(graph, nodes, machine):
    services = {
        node.resolve_service_name(service.srv_name): type_name(service.srv_type)
        for node in nodes
        for service in node.services
    }
    offered = {name: kind for name, kind in services.items() if not OF_ROS.fullmatch(name)}
    assert offered == {
        name: row['type'] for row in tables('Services') for name in for_joints(row['service'], machine.joints)
    }
    actions = [(row['action'].strip('`'), [row['type']]) for row in tables('Actions')]
    if find_action():  # control_msgs is installed
        actions = sorted([*actions, ('/pkm/follow_joint_trajectory', ['control_msgs/action/FollowJointTrajectory'])])
    graph.spin_until(lambda: get_action_names_and_types(graph.node) == actions, f'the action(s) {actions}')


def test_keys_of_diagnostics_are_documented(graph, machine, tmp_path):
    """The page lists the words that are values of the key `state`."""
    rows = tables('Diagnostics')
    keys = {row['node']: set() for row in rows}
    for row in rows:
        keys[row['node']] |= set(for_joints(row['key'], machine.joints))
    states = {row['node']: re.findall(r'`(\w+)`', row['value']) for row in rows if row['key'] == '`state`'}
    received = graph.listen(DiagnosticArray, '/diagnostics')
    graph.start(MachineNode)
    graph.start(JointControllerNode)
    graph.start(RecorderNode, folder=str(tmp_path))
    graph.start(StateEstimatorNode)
    graph.start(TrajectoryGeneratorNode)
    latest = {}

    def has_all():
        latest.update({node_of(status).removeprefix('/pkm/'): status for array in received for status in array.status})
        return latest.keys() == keys.keys()

    graph.spin_until(has_all, 'the diagnostics of every kind of node')
    for name, status in latest.items():
        found = values_of(status)
        assert found.keys() == keys[name]
        assert found['state'] in states[name]


def layout_paths():
    """Return topic and fields of every curve of the layouts."""
    foxglove = json.loads((LAYOUTS / 'foxglove.json').read_text(encoding='utf-8'))
    shown = [path['value'] for panel in foxglove['configById'].values() for path in panel.get('paths', [])]
    paths = [(topic, fields.split('.')) for topic, _, fields in (value.partition('.') for value in shown)]
    for panel in foxglove['configById'].values():
        topics = [*panel.get('topics', {}), panel.get('topicToRender'), panel.get('topicPath')]
        paths += [(topic, []) for topic in topics if topic]
    for curve in ElementTree.parse(LAYOUTS / 'plotjuggler.xml').iter('curve'):
        parts = curve.get('name').split('/')  # /pkm, topic of one or two names, fields
        named = 4 if parts[2].startswith('d') else 3
        paths.append(('/'.join(parts[:named]), parts[named:]))
    return paths


def test_layouts_show_topics_and_fields_that_exist(documented):
    paths = layout_paths()
    assert len(paths) > 30
    for topic, fields in paths:
        message = find_interface(documented[topic][0], 'msg')()
        for field in fields:
            message = getattr(message, field)


def test_foxglove_layout_places_every_panel_once():
    layout = json.loads((LAYOUTS / 'foxglove.json').read_text(encoding='utf-8'))

    def leaves(tree):
        return [tree] if isinstance(tree, str) else leaves(tree['first']) + leaves(tree['second'])

    assert sorted(leaves(layout['layout'])) == sorted(layout['configById'])
