# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors reach whoever waits for a pool of processes as they were raised."""

import pickle

import pytest
from spm_haptic_master.exceptions import GeometryError, InputError, RejectedError, SettingError


@pytest.mark.parametrize(
    'error',
    [
        RejectedError('starting', '1 consistent sample of 5'),
        SettingError('rate', -1.0, 'a number from 1 to 10000'),
        SettingError('rate', None, 'a number'),
        SettingError('a\nb', 1, 'a number'),
        InputError('a\nb\\n'),
    ],
)
def test_an_error_survives_the_way_to_another_process(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)


@pytest.mark.parametrize('kind', [InputError, GeometryError])
def test_an_error_of_an_input_is_one_line_that_can_be_printed(kind):
    assert str(kind('a\nb\r\t\x1b[31m\u2028\udcff, 5\N{DEGREE SIGN}')) == (
        r'a\nb\r\t\x1b[31m\u2028\udcff, 5' '\N{DEGREE SIGN}'
    )
