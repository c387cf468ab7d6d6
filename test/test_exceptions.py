# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors reach whoever waits for a pool of processes as they were raised."""

import pickle

import pytest
from spm_haptic_master.exceptions import RejectedError, SettingError


@pytest.mark.parametrize('error', [
    RejectedError('starting', '1 consistent sample of 5'),
    SettingError('rate', -1.0, 'a number from 1 to 10000'),
    SettingError('rate', None, 'a number')])
def test_an_error_survives_the_way_to_another_process(error):
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)
