# SPDX-License-Identifier: Apache-2.0
from glob import glob
from os.path import dirname, join
from xml.etree import ElementTree

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
    'joint-forces',
    'layouts',
    'margins',
    'open-loop',
    'report',
    'singularity',
    'tolerance',
    'tune',
    'workspace',
]

MANIFEST = ElementTree.parse('package.xml')  # the one source of version, description, maintainer and licence

setup(
    name='pkm_core',
    version=MANIFEST.findtext('version'),
    description=MANIFEST.findtext('description'),
    packages=find_packages(),
    package_data={'pkm_core': ['py.typed', '__init__.pyi']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/pkm_core']),
        ('share/pkm_core', ['package.xml']),
        *((join('share/pkm_core', dirname(path)), [path]) for path in CONFIG),
    ],
    zip_safe=True,
    maintainer=MANIFEST.findtext('maintainer'),
    maintainer_email=MANIFEST.find('maintainer').get('email'),
    license=MANIFEST.findtext('license'),
    entry_points={
        'console_scripts': ['pkm = pkm_core.cli:main'],
        'numba_extensions': ['init = pkm_core.kernel_cache:ignore_damage'],
        'pkm.verbs': [f'{verb} = pkm_core.verbs.{verb.replace("-", "_")}:{verb.replace("-", "_")}' for verb in VERBS],
    },
)
