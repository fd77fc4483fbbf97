from glob import glob
from os.path import dirname, join

from setuptools import find_packages, setup

CONFIG = sorted(glob('config/**/*.yaml', recursive=True))  # config is a link to the top level's

# `pkm VERB` is the function VERB of pkm_core/verbs/VERB.py
VERBS = [
    'bag-doctor',
    'budget',
    'calibrate',
    'convergence',
    'drive-response',
    'experiment',
    'identify',
    'identify-bag',
    'margins',
    'open-loop',
    'report',
    'singularity',
    'tolerance',
    'tune',
    'workspace',
]

setup(
    name='pkm_core',
    version='0.1.0',
    description='Mechanism, dynamics, drives, control and learning of the parallel-manipulator cell, without ROS.',
    packages=find_packages(),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/pkm_core']),
        ('share/pkm_core', ['package.xml']),
        *((join('share/pkm_core', dirname(path)), [path]) for path in CONFIG),
    ],
    zip_safe=True,
    maintainer='PKM cell maintainers',
    maintainer_email='maintainers@pkm-cell.org',
    license='Apache-2.0',
    entry_points={
        'console_scripts': ['pkm = pkm_core.cli:main'],
        'pkm.verbs': [f'{verb} = pkm_core.verbs.{verb.replace("-", "_")}:{verb.replace("-", "_")}' for verb in VERBS],
    },
)
