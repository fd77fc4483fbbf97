# SPDX-License-Identifier: Apache-2.0
from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

NODES = [
    'trajectory_generator',
    'inverse_kinematics',
    'joint_controller',
    'computed_torque_controller',
    'machine',
    'state_estimator',
    'learning',
    'tool_learning',
    'identification',
    'calibration',
    'recorder',
    'cell',
    'dashboard',
]

MANIFEST = ElementTree.parse('package.xml')  # the one source of version, description, maintainer and licence

setup(
    name='pkm_nodes',
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    packages=find_packages(),
    package_data={'pkm_nodes': ['fastdds.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/pkm_nodes']),
        ('share/pkm_nodes', ['package.xml']),
        ('share/pkm_nodes/launch', glob('launch/*.launch.py')),
        ('share/pkm_nodes/urdf', glob('urdf/*.urdf')),
        ('share/pkm_nodes/layouts', glob('layouts/*')),
    ],
    zip_safe=True,
    maintainer=MANIFEST.findtext('maintainer'),
    maintainer_email=MANIFEST.find('maintainer').get('email'),
    license=MANIFEST.findtext('license'),
    entry_points={
        'console_scripts': [f'{node} = pkm_nodes.executables:{node}' for node in NODES],
        # verbs that need ROS; pkm_core.app adds every verb it finds in this group
        'pkm.verbs': [
            'calibrate-cell = pkm_nodes.verbs.calibrate_cell:calibrate_cell',
            'bench = pkm_nodes.verbs.bench:bench',
            'bag-play = pkm_nodes.verbs.bag_play:bag_play',
            'commission = pkm_nodes.verbs.commission:commission',
            'identify-cell = pkm_nodes.verbs.identify_cell:identify_cell',
            'page = pkm_nodes.verbs.page:page',
            'parameters = pkm_nodes.verbs.parameters:parameters',
            'run = pkm_nodes.verbs.run:run',
            'go-to = pkm_nodes.verbs.go_to:go_to',
            'home = pkm_nodes.verbs.go_to:home',
            'stop = pkm_nodes.verbs.stop:stop',
        ],
        # what `pkm experiment --arrangement` finds the graph by
        'pkm.graphs': ['drive = pkm_nodes.clients.experiment_driver:drive'],
    },
)
