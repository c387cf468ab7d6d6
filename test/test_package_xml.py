# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the package states of itself: package.xml and setup.py agree with the code."""

import re
import subprocess
import sys

from catkin_pkg.package import parse_package
import pytest
from spm_haptic_master.__main__ import RCLPY_MINIMUM
from test_house import imports, PACKAGE, ROOT
import yaml

# rosdep keys that are not the module's name.
ROSDEP = {'numpy': 'python3-numpy', 'can': 'python3-can', 'yaml': 'python3-yaml',
          'matplotlib': 'python3-matplotlib', 'pytest': 'python3-pytest',
          'hypothesis': 'python3-hypothesis', 'catkin_pkg': 'python3-catkin-pkg-modules'}
# Modules that rosdep brings by pip only, which Ubuntu 24.04 refuses outside a virtual environment:
# extras of setup.py; the rest of the package works without them. crtk_msgs is built from source.
EXTRA = {'canopen', 'crtk_msgs', 'msgspec', 'mujoco', 'pyte', 'rosbags', 'viser', 'websockets'}
# Dependencies that no import shows: the interface udp_multicast of python-can, `ros2 launch`, and
# a node of others that launch/display.launch.py starts. (RViz is for the host of the person who
# looks: a rig's needs none.)
INDIRECT = {'python3-msgpack', 'ros2launch', 'robot_state_publisher'}


@pytest.fixture(scope='module')
def package():
    return parse_package(str(ROOT / 'package.xml'))


def imported(*folders):
    """Return the top-level modules that the folders' files import from outside the package."""
    names = {name.split('.')[0] for folder in folders
             for path in (ROOT / folder).rglob('*.py') for name in imports(path)}
    return names - {PACKAGE, ''} - EXTRA - set(sys.stdlib_module_names)


def test_package_xml_is_valid(package):
    warnings = []
    package.validate(warnings=warnings)
    assert not warnings
    assert package.package_format == 3
    assert package.licenses == ['Apache-2.0']
    assert package.get_build_type() == 'ament_python'
    assert {url.type for url in package.urls} == {'repository', 'bugtracker'}
    (rclpy,) = [each for each in package.exec_depends if each.name == 'rclpy']
    assert rclpy.version_gte == RCLPY_MINIMUM


def test_package_xml_names_what_the_code_imports(package):
    named = {dependency.name for dependency in package.exec_depends}
    used = {ROSDEP.get(name, name) for name in imported(PACKAGE, 'launch')}
    assert used <= named, f'not in package.xml: {sorted(used - named)}'
    assert named <= used | INDIRECT, f'not imported: {sorted(named - used - INDIRECT)}'


def test_package_xml_names_what_the_tests_import(package):
    named = {dependency.name for dependency in package.exec_depends + package.test_depends}
    local = {path.stem for path in (ROOT / 'test').rglob('*.py')} | {
        'paper', 'study', 'benchmarks', 'docs', 'release'}
    used = {ROSDEP.get(name, name) for name in imported('test') - local}
    assert used <= named, f'not in package.xml: {sorted(used - named)}'


@pytest.mark.packaging
def test_setup_and_package_xml_agree(package):
    fields = ('version', 'url', 'license', 'author', 'author-email', 'maintainer',
              'maintainer-email')
    done = subprocess.run(
        [sys.executable, 'setup.py', '--quiet', *(f'--{field}' for field in fields)],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=True)
    setup = dict(zip(fields, done.stdout.splitlines()[-len(fields):], strict=True))
    assert package.version == setup['version']
    urls = {url.type: url.url for url in package.urls}
    assert setup['url'] == urls['repository']
    assert urls['bugtracker'].startswith(urls['repository'])
    assert setup['license'] in package.licenses
    for role, people in (('author', package.authors), ('maintainer', package.maintainers)):
        assert [(person.name, person.email) for person in people] == \
            [(setup[role], setup[f'{role}-email'])]


def test_the_citation_is_of_this_package(package):
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert {'cff-version', 'message', 'title', 'authors'} <= set(citation)
    assert citation['license'] in package.licenses
    assert citation['repository-code'] in {url.url for url in package.urls}


def test_the_quality_declaration_follows_the_version(package):
    rows = dict(re.findall(r'^\| (1\.\w+) [^|]*\| (\w+) \|', (
        ROOT / 'QUALITY_DECLARATION.md').read_text(), re.MULTILINE))
    stable = 'no' if package.version.startswith('0.') else 'yes'
    assert rows['1.ii'] == rows['1.vi'] == stable
