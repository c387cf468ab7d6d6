# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum likelihood with a sensor missing: any three of four, and where three fail."""

import math

from mechanism import (
    angle_between,
    CENTRE,
    MODES,
    reachable_rotation,
    SINGULAR_PHI,
    small_vector,
    tilted,
    turn,
    zxz,
)
import numpy as np
import pytest
from readings import four_angles, SIGMA
from spm_haptic_master.exceptions import InputError, SingularityError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import (
    estimate,
    estimate_sample,
    Geometry,
    jacobian,
    UsedSensors,
)


@pytest.mark.parametrize('missing', JOINT_NAMES)
def test_any_three_of_four(missing):
    rng = np.random.default_rng(65)
    index = JOINT_NAMES.index(missing)
    present = [sensor for sensor in range(4) if sensor != index]
    for mode in MODES:
        R = reachable_rotation(rng, Geometry(), slack=0.1)
        G = jacobian(R, working_mode=mode, sensors=4)[present]
        if np.linalg.cond(G) > 20.0:
            continue
        sigma = SIGMA * np.array([1.0, 2.0, 0.5, 1.5])
        prior = turn(math.radians(0.5) * rng.normal(size=3)) @ R
        angles = four_angles(R, mode=mode)
        without = np.where(np.arange(4) == index, np.nan, angles)
        exact = estimate(without[:3], without[3], sigma, prior=prior, missing=missing)
        assert angle_between(exact.rotation, R) < 1e-9
        assert exact.determined and np.isnan(exact.parity)
        inverse_rows = np.linalg.inv(G)
        expected = inverse_rows @ np.diag(sigma[present]**2) @ inverse_rows.T
        np.testing.assert_allclose(exact.covariance, expected, rtol=1e-3, atol=1e-9)
        readings = angles + sigma * rng.normal(size=(300, 4))
        readings[:, index] = np.nan
        noisy = estimate(readings[:, :3], readings[:, 3], sigma, prior=prior, missing=missing)
        error = small_vector(noisy.rotation @ R.T)
        chi2 = np.einsum('ni,ij,nj->n', error, np.linalg.inv(expected), error).mean()
        assert abs(chi2 - 3.0) < 0.6
        # The three readings there are must be met.
        met = four_angles(noisy.rotation[0], mode=mode)[present]
        np.testing.assert_allclose(met, readings[0, present], atol=1e-7)


def test_three_active_sensors_at_the_singularity_do_not_determine():
    R = zxz(*CENTRE, SINGULAR_PHI)
    angles = four_angles(R)
    assert estimate(angles[:3], angles[3], SIGMA).determined
    try:
        found = estimate(angles[:3], angles[3], SIGMA, prior=R, missing='joint_3a')
    except SingularityError:
        return
    assert not found.determined


def test_three_active_sensors_determine_only_away_from_the_singularity():
    # 1-sigma bound about 2.9 deg at phi = 50 deg (facts.md, section 4), growing towards 49.36 deg.
    deviations = []
    for phi_deg in (53.0, 50.0, 49.46):
        R = zxz(*CENTRE, math.radians(phi_deg))
        angles = four_angles(R)
        found = estimate(angles[:3], angles[3], SIGMA, prior=R, missing='joint_3a')
        assert angle_between(found.rotation, R) < 1e-9
        deviations.append(math.degrees(math.sqrt(np.trace(found.covariance))))
        assert found.determined == (phi_deg > 49.5)
    assert deviations[0] < deviations[1] < deviations[2]
    assert deviations[1] == pytest.approx(2.9, abs=0.05)


def test_missing_needs_a_prior():
    angles = four_angles(tilted(0.3, 0.0, 0.0))
    with pytest.raises(InputError, match='prior'):
        estimate(angles[:3], angles[3], SIGMA, missing='joint_1b')
    with pytest.raises(InputError, match='prior'):
        estimate_sample(tuple(angles.tolist()), UsedSensors((SIGMA,) * 4, (1,)), Geometry())
