# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motions that are too short for a calibration, or have a pause: one line, no traceback."""

from math import radians

from free_motions import SHORT
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion
from spm_haptic_master.calibration.motion.mechanism_parameters import Layout
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.simulation.rig import random_rig
from spm_haptic_master.simulation.rig import Tolerances as Deviations

RIG = random_rig(12, Deviations(radians(0.3), radians(0.3), radians(0.12), radians(0.015)))


@pytest.fixture(scope='module')
def motion():
    """Return stamps and raw readings."""
    return readings(RIG, SHORT, 41)[:2]


def calibrate(stamps, raw):
    return calibrate_motion(Layout(4), stamps, raw)


@pytest.mark.parametrize('seconds', [1.5, 2.5, 3.9])
@pytest.mark.parametrize('begin', [0.0, 7.0])
def test_a_short_motion_is_refused_by_its_length(motion, begin, seconds):
    stamps, raw = motion
    since = (stamps - stamps[0]) * 1e-9
    part = (since >= begin) & (since < begin + seconds)
    with pytest.raises(CalibrationError, match=f'the motion lasts {seconds:g}.* more than 4 s'):
        calibrate(stamps[part], raw[part])


def test_a_motion_whose_held_out_part_is_a_pause_is_refused(motion):
    stamps, raw = motion
    since = (stamps - stamps[0]) * 1e-9
    part = (since < 3.9) | (since > 6.1) & (since < 9.9)
    with pytest.raises(CalibrationError, match='without a long pause'):
        calibrate(stamps[part], raw[part])


@pytest.mark.slow
@pytest.mark.parametrize('seconds', [
    4.1, *(pytest.param(seconds, marks=pytest.mark.evidence) for seconds in (5.0, 8.0))])
def test_a_motion_that_is_a_little_longer_ends_without_a_traceback(motion, seconds):
    stamps, raw = motion
    part = (stamps - stamps[0]) * 1e-9 < seconds
    try:
        found = calibrate(stamps[part], raw[part])
    except CalibrationError as error:
        assert '\n' not in str(error)
    else:
        assert np.isfinite(found.vector).all() and np.isfinite(found.bias).all()
