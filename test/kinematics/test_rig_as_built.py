# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording of a rig with ordinary tolerances, from its CAN frames to orientations."""

import math

import can
from encoder_frames import decoder
import numpy as np
import pytest
from rig_as_built import calibration, errors_deg, LOG, mechanism, SETS, truth
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.supervision import supervise


@pytest.mark.slow
def test_the_supervision_publishes_the_rig_as_built():
    taker = decoder(**{
        name.replace('.', '__'): tuple(value) for name, value in calibration().items()})
    with can.LogReader(LOG) as log:
        samples = [sample for sample in map(taker.feed, log) if sample is not None]
    assert len(samples) == SETS
    stamps = np.array([sample.stamp for sample in samples])
    found = supervise(stamps, np.array([sample.angles for sample in samples]), **{
        name.replace('.', '__'): value for name, value in mechanism().items()})
    # The truth is known of every tenth sample.
    times, true = truth()
    index = np.searchsorted(stamps, times * 1e9 - 100_000)
    assert np.abs(stamps[index] * 1e-9 - times).max() < 1e-4
    published = found.published[index]
    quaternions = found.quaternion[index]
    errors = errors_deg(matrix_from_quaternion(quaternions[published]), true[published])
    rms = math.sqrt((errors**2).mean())
    print(f'{found.published.sum()} of {SETS} published, rms {rms:.4f} deg, largest '
          f'{errors.max():.3f} deg, protection level to {np.nanmax(found.protection_level):.2f}')
    assert found.published.sum() >= 0.999 * SETS
    assert rms <= 0.055 and errors.max() <= 0.3
    level = found.protection_level[index]
    assert (errors < level[np.isfinite(level)]).all()
