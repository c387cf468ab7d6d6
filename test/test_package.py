# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""package.xml and setup.py agree with the code; the package builds and installs in every way."""

import os
from pathlib import Path
import re
import shutil
import subprocess
import sys

from catkin_pkg.package import parse_package
from harness import environment
import pytest
from spm_haptic_master.__main__ import RCLPY_MINIMUM
from spm_haptic_master.executables import EXECUTABLES
from test_house import imports, PACKAGE, ROOT
import yaml

# rosdep keys that are not the module's name.
ROSDEP = {
    'numpy': 'python3-numpy',
    'can': 'python3-can',
    'yaml': 'python3-yaml',
    'matplotlib': 'python3-matplotlib',
    'pytest': 'python3-pytest',
    'hypothesis': 'python3-hypothesis',
    'catkin_pkg': 'python3-catkin-pkg-modules',
}
# Modules that rosdep brings by pip only, which Ubuntu 24.04 refuses outside a virtual environment:
# extras of setup.py; the rest of the package works without them. crtk_msgs is built from source.
EXTRA = {
    'canopen',
    'cantools',
    'crtk_msgs',
    'msgspec',
    'mujoco',
    'rosbags',
    'viser',
    'websockets',
    'zstandard',
}
# Dependencies that no import shows: the interface udp_multicast of python-can, `ros2 launch`, and
# a node of others that launch/display.launch.py starts. (RViz is for the host of the person who
# looks: a rig's needs none.)
INDIRECT = {'python3-msgpack', 'ros2launch', 'robot_state_publisher'}
# Files that are installed beside the code.
SHARED = (
    'package.xml',
    *(
        path.relative_to(ROOT)
        for folder in ('config', 'launch', 'urdf')
        for path in (ROOT / folder).rglob('*.*')
        if path.suffix != '.pyc'
    ),
)


@pytest.fixture(scope='module')
def package():
    return parse_package(str(ROOT / 'package.xml'))


def imported(*folders):
    """Return what the folders' files import from outside the package, as rosdep names it."""
    names = {
        name.split('.')[0]
        for folder in folders
        for path in (ROOT / folder).rglob('*.py')
        for name in imports(path)
    }
    return {
        ROSDEP.get(name, name)
        for name in names - {PACKAGE, ''} - EXTRA - set(sys.stdlib_module_names)
    }


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


def test_package_xml_names_what_code_and_tests_import(package):
    named = {dependency.name for dependency in package.exec_depends}
    assert named == imported(PACKAGE, 'launch') | INDIRECT
    modules = list((ROOT / 'test').rglob('*.py'))
    packages = {path.parent.name for path in modules if path.name == '__init__.py'}
    local = (
        packages
        | {path.stem for path in modules}
        | {
            'paper',
            'study',
            'benchmarks',
            'docs',
            'release',
        }
    )
    named |= {dependency.name for dependency in package.test_depends}
    assert imported('test') - local <= named


@pytest.mark.packaging
def test_setup_and_package_xml_agree(package):
    fields = (
        'version',
        'url',
        'license',
        'author',
        'author-email',
        'maintainer',
        'maintainer-email',
    )
    printed = run(
        [sys.executable, 'setup.py', '--quiet', *(f'--{field}' for field in fields)], cwd=ROOT
    )
    setup = dict(zip(fields, printed.splitlines()[-len(fields) :], strict=True))
    assert package.version == setup['version']
    urls = {url.type: url.url for url in package.urls}
    assert setup['url'] == urls['repository']
    assert urls['bugtracker'].startswith(urls['repository'])
    assert setup['license'] in package.licenses
    for role, people in (('author', package.authors), ('maintainer', package.maintainers)):
        assert [(person.name, person.email) for person in people] == [
            (setup[role], setup[f'{role}-email'])
        ]


def test_citation_and_quality_declaration_are_of_this_package_and_version(package):
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert {'cff-version', 'message', 'title', 'authors'} <= set(citation)
    assert citation['license'] in package.licenses
    rows = dict(
        re.findall(
            r'^\| (1\.\w+) [^|]*\| (\w+) \|',
            (ROOT / 'QUALITY_DECLARATION.md').read_text(),
            re.MULTILINE,
        )
    )
    stable = 'no' if package.version.startswith('0.') else 'yes'
    assert rows['1.ii'] == rows['1.vi'] == stable


def run(command, **kwargs):
    """Run a command that has to succeed; return what it printed."""
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=300,
        **kwargs,
    )
    assert done.returncode == 0, f'{command}\n{done.stdout}\n{done.stderr}'
    return done.stdout


@pytest.fixture
def source(tmp_path):
    """Return a copy of the package without what was built or installed here."""
    copy = tmp_path / 'ws' / 'src' / PACKAGE
    shutil.copytree(
        ROOT,
        copy,
        ignore=shutil.ignore_patterns(
            '.*',
            'build',
            'install',
            'log',
            'test',
            'docs',
            'benchmarks',
            '*.egg-info',
            '__pycache__',
        ),
    )
    return copy


@pytest.mark.packaging
@pytest.mark.parametrize(
    'options',
    [(), ('--symlink-install',)],
    ids=['copied', 'symlinked'],
)
def test_colcon_build(source, options):
    workspace = source.parents[1]
    run(
        [Path(sys.executable).parent / 'colcon', 'build', *options],
        cwd=workspace,
        env=environment(),
    )
    prefix = workspace / 'install' / PACKAGE
    for name in SHARED:
        assert (prefix / 'share' / PACKAGE / name).is_file()
    assert (prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / PACKAGE).exists()
    # On the sourced workspace each executable is where `ros2 run` expects it, and finds its files.
    for name in EXECUTABLES:
        assert os.access(prefix / 'lib' / PACKAGE / name, os.X_OK)
    done = subprocess.run(
        [
            'bash',
            '-c',
            f'source {workspace}/install/setup.bash && cd / && '
            f'{prefix}/lib/{PACKAGE}/encoder_driver -p source:=sim -p rate:=0',
        ],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("encoder_driver: parameter 'rate' is 0; expected")


@pytest.mark.packaging
def test_pip_install(source, tmp_path):
    """Installed, and then editable, in one environment without ROS."""
    clean = {
        name: value
        for name, value in os.environ.items()
        if name not in ('PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'LD_LIBRARY_PATH')
    }
    run([sys.executable, '-m', 'venv', '--without-pip', tmp_path / 'venv'], env=clean)
    python = tmp_path / 'venv' / 'bin' / 'python'
    pip = [sys.executable, '-m', 'pip', '-q', '--python', python]
    for options in (), ('--editable',):
        run([*pip, 'install', '--no-compile', *options, source], env=clean)
        # The mathematics and the encoders work, and the programs are installed.
        run(
            [
                python,
                '-c',
                'from spm_haptic_master.kinematics import Geometry, inverse\n'
                'import spm_haptic_master.simulation.source_factory',
            ],
            env=clean,
            cwd=tmp_path,
        )
        for name in EXECUTABLES:
            assert os.access(python.parent / name, os.X_OK)
        if not options:
            for name in SHARED:
                assert (tmp_path / 'venv' / 'share' / PACKAGE / name).is_file()
            (site,) = (tmp_path / 'venv' / 'lib').glob('python*/site-packages')
            assert (site / PACKAGE / 'py.typed').is_file()
            assert not {'paper', 'study', 'benchmarks', 'docs', 'examples', 'release', 'test'} & {
                path.name for path in site.iterdir()
            }
            run([*pip, 'uninstall', '--yes', PACKAGE], env=clean)
            assert not (python.parent / 'master').exists()
