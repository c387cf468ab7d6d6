# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""recorder: what validate reads, from the running nodes."""

import time

from harness import SIM
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.validation import recordings

pytestmark = pytest.mark.process


def test_orientations_and_joint_angles_are_recorded(start, tmp_path):
    directory = tmp_path / 'new' / 'recording'
    recorder = start('recorder', parameters={'directory': directory})
    start('fkm')
    driver = start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    path = directory / 'orientation.csv'
    assert wait_until(lambda: path.exists() and path.stat().st_size > 20_000, 60.0)
    driver.stop()
    time.sleep(0.2)
    assert recorder.stop() == 0
    assert recorder.stderr == ''

    orientations = recordings.read_orientation(path, '')
    joints = recordings.read_joints(directory / 'measured_js.csv', '')
    # Either topic may be heard a moment before the other.
    assert min(len(joints.time), len(orientations.time)) > 200
    # An orientation has the stamp of the angles it comes from.
    both = joints.time[joints.time >= orientations.time[0]]
    assert np.isin(both, orientations.time).mean() > 0.95
    assert np.abs(np.linalg.norm(orientations.values, axis=-1) - 1.0).max() < 1e-6


def test_a_directory_that_cannot_be_is_named(start, tmp_path):
    (tmp_path / 'file').write_text('')
    recorder = start('recorder', parameters={'directory': tmp_path / 'file' / 'below'})
    start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    assert recorder.wait(60.0) == 1
    assert recorder.stderr.startswith('recorder: ') and 'cannot be written' in recorder.stderr
    assert recorder.stderr.count('\n') == 1


def test_an_earlier_recording_is_not_overwritten(start, tmp_path):
    (tmp_path / 'orientation.csv').write_text('precious')
    recorder = start('recorder', parameters={'directory': tmp_path})
    assert recorder.wait(60.0) == 1
    assert 'already exists' in recorder.stderr and recorder.stderr.count('\n') == 1
    assert (tmp_path / 'orientation.csv').read_text() == 'precious'


def test_nothing_is_written_where_nothing_comes(start, observer, tmp_path):
    recorder = start('recorder', parameters={'directory': tmp_path / 'empty'})
    assert observer.spin_until(lambda: 'recorder' in observer.node.get_node_names(), 60.0)
    observer.spin(1.0)
    assert recorder.stop() == 0
    assert not (tmp_path / 'empty').exists()
