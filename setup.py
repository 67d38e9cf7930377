"""Package metadata; the one place that names what has to be installed."""

import sys
from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'ogm_mcmc'

SCRIPTS = [
    'ogm_mcmc = ogm_mcmc.cli.entry:main',
    'online_mapper = ogm_mcmc.ros.entry:online_mapper',
    'refine_server = ogm_mcmc.ros.entry:refine_server',
]
# colcon installs by these commands, with scripts in lib/ogm_mcmc (setup.cfg): `ros2 run` finds
# them there. A wheel puts them on the PATH, where `replay` would stand for anything.
if {'install', 'develop'} & set(sys.argv):
    SCRIPTS.append('replay = ogm_mcmc.ros.entry:replay')

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', glob('config/*.yaml')),
        (f'share/{PACKAGE}/launch', glob('config/launch/*.launch.py')),
        (f'share/{PACKAGE}/view', glob('config/view/*')),
        (f'share/{PACKAGE}/priors', glob('config/priors/*')),
    ],
    python_requires='>=3.11',
    install_requires=[
        'setuptools',
        'numpy>=1.26',
        'numba>=0.60',
        'rosbags>=0.11',
        'PyYAML>=6.0',
        'Pillow>=10.1',
        'tqdm>=4.64',
    ],
    extras_require={
        # ROS 2 Jazzy from PyPI; leave it out where a system ROS 2 provides rclpy.
        'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
        # Curves and pictures of `evaluate` and `experiment`.
        'plots': ['matplotlib>=3.7'],
        # Chains and data sets on other machines (`--scheduler`).
        'cluster': ['distributed>=2024.1'],
        'test': [
            'pytest>=7.4',
            'pytest-xdist>=3.5',
            'hypothesis>=6.90',
            'matplotlib>=3.7',
            'scipy>=1.11',
            'scikit-learn>=1.3',
            'distributed>=2024.1',
            'ruff>=0.9',
            'mypy>=1.10',
            'import-linter>=2.0',
            'types-PyYAML',
            'types-tqdm',
            'setuptools<80',
            'wheel',
            'colcon-common-extensions',
            'colcon-ros',
        ],
    },
    zip_safe=False,
    maintainer='ogm_mcmc maintainers',
    maintainer_email='maintainers@ogm-mcmc.org',
    description='Occupancy grid mapping with probabilities that can be believed.',
    license='Apache-2.0',
    entry_points={'console_scripts': SCRIPTS},
)
