# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package builds and installs in every way that its users take."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

from harness import environment, ROOT
import pytest
from spm_haptic_master.executables import EXECUTABLES

PACKAGE = 'spm_haptic_master'
SHARED = ('package.xml', 'config/sim.yaml', 'config/replay.yaml', 'config/can.yaml',
          'config/fastdds.xml', 'config/display.rviz', 'config/foxglove_layout.json',
          'config/dvrk_2.4.0.json', 'config/haptic_master.service',
          'launch/master.launch.py', 'launch/teleop.launch.py', 'launch/display.launch.py',
          'urdf/spm.urdf', 'urdf/meshes/platform.stl')


def run(command, **kwargs):
    """Run a command that has to succeed; return what it printed."""
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, **kwargs)
    assert done.returncode == 0, f'{command}\n{done.stdout}\n{done.stderr}'
    return done.stdout + done.stderr


@pytest.fixture
def source(tmp_path):
    """Return a copy of the package without what was built or installed here."""
    copy = tmp_path / 'ws' / 'src' / PACKAGE
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(
        '.*', 'build', 'install', 'log', 'test', 'docs', 'benchmarks', '*.egg-info',
        '__pycache__'))
    return copy


@pytest.mark.packaging
@pytest.mark.parametrize('options', [(), ('--symlink-install',)], ids=['copied', 'symlinked'])
def test_colcon_build(source, options):
    workspace = source.parents[1]
    run([Path(sys.executable).parent / 'colcon', 'build', *options], cwd=workspace,
        env=environment())
    prefix = workspace / 'install' / PACKAGE
    for name in SHARED:
        assert (prefix / 'share' / PACKAGE / name).is_file()
    marker = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / PACKAGE
    assert marker.exists()
    # On the sourced workspace each executable is where `ros2 run` expects it, and finds its files.
    for name in EXECUTABLES:
        assert os.access(prefix / 'lib' / PACKAGE / name, os.X_OK)
    done = subprocess.run(
        ['bash', '-c', f'source {workspace}/install/setup.bash && cd / && '
         f'{prefix}/lib/{PACKAGE}/encoder_driver -p source:=sim -p rate:=0'],
        env=environment(), capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.startswith("encoder_driver: parameter 'rate' is 0; expected")


@pytest.mark.packaging
def test_pip_install(source, tmp_path):
    """Installed, and then editable, in one environment without ROS."""
    clean = {name: value for name, value in os.environ.items()
             if name not in ('PYTHONPATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'LD_LIBRARY_PATH')}
    run([sys.executable, '-m', 'venv', tmp_path / 'venv'], env=clean)
    python = tmp_path / 'venv' / 'bin' / 'python'
    for options in (), ('--editable',):
        run([python, '-m', 'pip', '-q', 'install', *options, source], env=clean)
        # The mathematics and the encoders work, and the programs are installed.
        run([python, '-c', 'from spm_haptic_master.kinematics import Geometry, inverse\n'
             'import spm_haptic_master.simulation.source_factory'], env=clean, cwd=tmp_path)
        for name in EXECUTABLES:
            assert os.access(python.parent / name, os.X_OK)
        if not options:
            for name in SHARED:
                assert (tmp_path / 'venv' / 'share' / PACKAGE / name).is_file()
            site, = (tmp_path / 'venv' / 'lib').glob('python*/site-packages')
            assert (site / PACKAGE / 'py.typed').is_file()
            assert not {'paper', 'study', 'benchmarks', 'docs', 'examples', 'release', 'test'} \
                & {path.name for path in site.iterdir()}
            run([python, '-m', 'pip', '-q', 'uninstall', '--yes', PACKAGE], env=clean)
            assert not (python.parent / 'master').exists()
