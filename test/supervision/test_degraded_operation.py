# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientations from the three healthy sensors, and where they stop."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.joints import JOINT_NAMES
from supervised import (
    PLACES,
    readings,
    Run,
    supervisor,
    turning,
)


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_degraded_operation_goes_on_with_its_larger_covariance(sensor):
    rotations, angles = readings(PLACES['swinging'], 2500, seed=sensor)
    angles[1000:, sensor] += radians(3.0)
    run = Run(supervisor(degraded=True, alert_limit=radians(2.0)), angles, rotations)
    assert JOINT_NAMES[sensor] in run.states[-1]
    assert run.states[-1].startswith('degraded')
    assert run.out[1003:].all()
    late = slice(1003, None)
    assert np.mean(run.error[late] < run.bound[late]) > 0.99
    assert np.all(run.error[late] < run.level[late])
    assert np.mean(run.bound[late]) > np.nanmean(run.bound[:1000])
    # It is declared that nobody checks it.
    assert np.all(np.diff(run.unchecked[1010:, sensor]) > 0.0)


@pytest.mark.parametrize(('limits', 'reason', 'between'), [
    ({}, 'protection level above the alert limit', (34.0, 39.0)),
    ({'deviation': radians(0.15), 'alert_limit': radians(3.0)}, 'orientation not determined',
     (35.0, 39.0))])
def test_without_th3a_it_stops_before_the_singularity(limits, reason, between):
    rotations, angles = readings(turning(15.0, 0.1, 34.36), 4500)
    angles[100:, 3] += radians(3.0)
    run = Run(supervisor(degraded=True, **limits), angles, rotations)
    phi = 34.36 + 15.0 * np.sin(2.0 * np.pi * 0.1 * np.arange(4500) * 1e-3)
    last = np.flatnonzero(run.out)[-1]
    assert between[0] < phi[last] < between[1]
    # The state is never `degraded` for longer than a spike while nothing is published.
    assert set(run.states[last + 3:]) == {f'silent: {reason}'}
    assert np.all(run.error[run.out] < run.level[run.out])
    # It came back from the singularity without an orientation: only all four sensors can restart.
    assert not run.out[last + 1:].any()
