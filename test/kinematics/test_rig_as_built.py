# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A recording of a rig with ordinary tolerances, from its CAN frames to orientations."""

from functools import cache
import math

import can
from encoder_frames import decoder
import numpy as np
import pytest
from rig_as_built import calibration, errors_deg, LOG, mechanism, rig, SETS, truth
from spm_haptic_master.kinematics import estimate, Geometry, matrix_from_quaternion
from spm_haptic_master.supervision import supervise

pytestmark = pytest.mark.slow
SIGMA = math.radians(0.04)


@cache
def recording():
    """Return the stamps, ns, and the angles of the joints, rad, (20000, 4)."""
    given = {name.replace('.', '__'): tuple(value) for name, value in calibration().items()}
    taker = decoder(**given)
    with can.LogReader(LOG) as log:
        samples = [sample for sample in map(taker.feed, log) if sample is not None]
    return (np.array([sample.stamp for sample in samples]),
            np.array([sample.angles for sample in samples]))


def at_truth(values):
    """Return those of the values, one a sample, of which the truth is known, and the truth."""
    times, true = truth()
    index = np.searchsorted(recording()[0], times * 1e9 - 100_000)
    assert np.abs(recording()[0][index] * 1e-9 - times).max() < 1e-4
    return values[index], true


def test_the_mechanism_as_built_explains_the_recording():
    stamps, angles = recording()
    assert len(stamps) == SETS
    built = Geometry.from_axes(
        rig()['base_axes'], rig()['platform_axes'], np.radians(rig()['alpha_deg']),
        np.radians(rig()['beta_deg']))
    found = estimate(angles[:, :3], angles[:, 3], SIGMA, built)
    errors = errors_deg(*at_truth(found.rotation))
    rms = math.sqrt((errors**2).mean())
    print(f'rms {rms:.4f} deg, largest {errors.max():.3f} deg, parity {found.parity.std():.3f}')
    assert len(errors) == 2000
    assert rms <= 0.055 and errors.max() <= 0.3
    assert found.consistent.mean() >= 0.999
    # What is left beside the noise are the second harmonics.
    assert found.parity.std() < 1.2


def test_the_supervision_publishes_the_rig_as_built():
    found = supervise(*recording(), **{
        name.replace('.', '__'): value for name, value in mechanism().items()})
    published, true = at_truth(found.published)
    quaternions, _ = at_truth(found.quaternion)
    errors = errors_deg(matrix_from_quaternion(quaternions[published]), true[published])
    rms = math.sqrt((errors**2).mean())
    print(f'{found.published.sum()} of {SETS} published, rms {rms:.4f} deg, largest '
          f'{errors.max():.3f} deg, protection level to {np.nanmax(found.protection_level):.2f}')
    assert found.published.sum() >= 0.999 * SETS
    assert rms <= 0.055 and errors.max() <= 0.3
    level, _ = at_truth(found.protection_level)
    assert (errors < level[np.isfinite(level)]).all()
