# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration of insertion and gripper in a parameter file, read and extended."""

import pytest
from spm_haptic_master.calibration.axis_file import extended_text, read_axis

GRIPPER = {
    'gripper.zero_count': 1200,
    'gripper.direction': -1,
    'gripper.range_deg': [0.0, 30.0],
}
INSERTION = {
    'insertion.zero_count': 40,
    'insertion.direction': 1,
    'insertion.counts_per_metre': 81920.0,
    'insertion.range': [0.0, 0.1],
}


@pytest.fixture
def file(tmp_path):
    """Return a file with the calibration of the gripper, then extended by the insertion."""
    path = tmp_path / 'calibration.yaml'
    assert not path.exists()
    path.write_text(extended_text(path, 'gripper:', '2026-11-26', GRIPPER))
    path.write_text(extended_text(path, 'insertion:', '2026-11-27', INSERTION))
    return path


def test_the_gripper_has_its_counts_a_degree_and_the_slide_its_counts_a_metre(file):
    gripper = read_axis(file, 'gripper', counts_per_turn=36_000)
    assert gripper.counts_per_unit == 100.0
    assert (gripper.zero_count, gripper.direction, gripper.range) == (1200, -1, (0.0, 30.0))
    insertion = read_axis(file, 'insertion', counts_per_turn=36_000)
    assert insertion.counts_per_unit == 81920.0
    assert (insertion.zero_count, insertion.range) == (40, (0.0, 0.1))


def test_the_comment_of_another_axis_stays_and_its_own_is_replaced(file):
    file.write_text(extended_text(file, 'gripper:', '2026-11-28', GRIPPER))
    comments = [line for line in file.read_text().splitlines() if line.startswith('#')]
    assert [line.lstrip('# ') for line in comments] == [
        'insertion: 2026-11-27',
        'gripper: 2026-11-28',
    ]
