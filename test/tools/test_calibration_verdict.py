# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a calibration is good for: refused, or for a region in words, and never a silent fkm."""

from dataclasses import replace
from math import radians
import re

from free_motions import calibrated, DEVIATIONS
import pytest
from simulated_hand import Condition, readings
from spm_haptic_master.calibration.motion.calibration import Origin
from spm_haptic_master.calibration.motion.coverage import region_of, WORKSPACE
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.simulation.rig import random_rig
from spm_haptic_master.tools.calibration_verdict import (
    FkmValues,
    least_alert_limit,
    published_share,
    supported,
)

pytestmark = pytest.mark.slow

RIG = random_rig(12, DEVIATIONS)
# Of a good encoder, which a short motion at 200 Hz determines enough.
QUIET = {'seconds': 40.0, 'noise': 0.01}
ORIGIN = Origin('', 'simulated', '', '', (16384,) * 4, {})


def silent(text, share):
    """Show no progress."""


def moved(**condition):
    """Return stamps, raw readings, directions and zeros of a motion at 200 Hz."""
    stamps, raw, direction, zeros = readings(RIG, Condition('motion', **QUIET | condition), 41)
    return stamps[::5], raw[::5], direction, zeros


@pytest.fixture(scope='module')
def motion():
    """Return a good motion."""
    return moved()


@pytest.fixture(scope='module')
def calibration(motion):
    """Return the calibration of the motion, and its model."""
    return calibrated(*motion)


def test_a_good_motion_is_for_the_workspace_and_is_published(calibration, motion):
    fkm = FkmValues({}, ORIGIN)
    found, limit = supported(calibration, fkm)
    assert found.region == WORKSPACE and limit <= 1.0
    assert published_share(found, motion[:2], fkm, silent) > 0.99
    # A task that tolerates more needs no more; one that tolerates less may need another motion.
    assert supported(calibration, FkmValues({'alert_limit_deg': 5.0}, ORIGIN))[1] == limit


def test_a_refusal_begins_with_what_to_do_and_names_a_limit_that_is_accepted(calibration):
    with pytest.raises(CalibrationError, match=r'^the motion does not support alert_limit_deg '
                       r'0\.25: (tilt|turn) the handle .*, and move for longer; a task that '
                       r'tolerates more may take -p alert_limit_deg:=[\d.]+ \(bias_deg'
                       ) as caught:
        supported(calibration, FkmValues({'alert_limit_deg': 0.25}, ORIGIN))
    named = float(re.search(r':=([\d.]+)', str(caught.value))[1])
    assert supported(calibration, FkmValues({'alert_limit_deg': named}, ORIGIN))[1] == named


def test_a_slip_that_leaves_fkm_silent_is_refused_with_the_reason(calibration, motion):
    stamps, raw, direction, _ = motion
    slipped = raw.copy()
    slipped[len(raw) // 2:, 1] += direction[1] * radians(1.0)
    with pytest.raises(CalibrationError, match=r'fkm publishes \d\d\.\d % of the motion, expected '
                       r'99 % at least: (?!settling).*\(\d+ samples\); nothing is written'):
        published_share(calibration, (stamps, slipped), FkmValues({}, ORIGIN), silent)


def test_small_tilts_are_refused():
    """The zeros of such a motion are known to some tenths of a degree over the workspace."""
    found = calibrated(*moved(tilt=5.0))
    with pytest.raises(CalibrationError, match='the region moved, .* is too small'):
        supported(found, FkmValues({}, ORIGIN))


@pytest.mark.evidence
def test_a_part_of_the_workspace_is_for_its_region_only():
    found = calibrated(*moved(tilt=11.0, turn_from=20.0, turn_to=75.0))
    any_limit = FkmValues({'alert_limit_deg': 30.0}, ORIGIN)
    region = region_of(found.rotation)
    least = least_alert_limit(replace(found, region=region), any_limit)
    assert least < least_alert_limit(found, any_limit)
    with pytest.raises(CalibrationError, match=rf'-p alert_limit_deg:={least:g} '):
        supported(found, FkmValues({'alert_limit_deg': 0.25}, ORIGIN))
    part, limit = supported(found, FkmValues({'alert_limit_deg': least}, ORIGIN))
    assert (part.region, limit) == (region, least)
    assert part.region_error < found.region_error and (part.bias <= found.bias).all()
