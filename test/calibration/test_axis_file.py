# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration of insertion and gripper in a parameter file, read and extended."""

import pytest
from spm_haptic_master.calibration.axis_file import axis_parameters, extended_text, read_axis
from spm_haptic_master.exceptions import InputError

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


def test_the_parameters_of_one_axis_or_of_both_are_those_for_all_nodes(file, tmp_path):
    assert axis_parameters(file) == {**GRIPPER, **INSERTION}
    assert axis_parameters(file, 'gripper') == GRIPPER
    text = file.read_text()
    file.write_text(text + 'driver:\n  ros__parameters:\n    gripper.zero_count: 7\n')
    assert axis_parameters(file, 'gripper') == GRIPPER
    assert axis_parameters(tmp_path / 'none.yaml') == {}


@pytest.mark.parametrize('parameters', [GRIPPER, INSERTION])
def test_a_file_without_a_parameter_of_the_axis_is_refused_with_its_name(tmp_path, parameters):
    path = tmp_path / 'calibration.yaml'
    for name in parameters:
        axis = name.split('.')[0]
        rest = {other: value for other, value in parameters.items() if other != name}
        path.write_text(
            extended_text(
                path,
                'part:',
                '2026-11-27',
                rest,
            )
        )
        expected = f'no {name}; expected what calibrate --{axis} wrote$'
        with pytest.raises(InputError, match=expected):
            read_axis(path, axis, counts_per_turn=36_000)
        path.unlink()
