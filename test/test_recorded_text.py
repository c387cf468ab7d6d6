# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording that differs: which line, what was found, what was expected."""

import pytest
from recorded_text import differences

RECORDED = '2.4 measured_cp.x 0.5\n2.4 measured_cp.y 0.25\n3.0 state silent: jumped\n'


def test_numbers_within_rounding_and_other_spaces_are_the_same():
    assert differences(RECORDED.replace('0.25', '  0.2501'), RECORDED) == []


@pytest.mark.parametrize(
    ('before', 'after', 'line'),
    [
        (
            'y 0.25',
            'y 0.26',
            "line 2: found '2.4 measured_cp.y 0.26', expected '2.4 measured_cp.y",
        ),
        ('silent: jumped', 'healthy', "line 3: found '3.0 state healthy', expected '3.0 state si"),
        ('2.4 measured_cp.x 0.5\n', '', "line 1: found None, expected '2.4 measured_cp.x 0.5'"),
        ('3.0', 'one more\n3.0', "line 2: found 'one more', expected None"),
    ],
)
def test_a_failure_names_line_value_and_expected(before, after, line):
    (found,) = differences(RECORDED.replace(before, after), RECORDED)
    assert found.startswith(line)
