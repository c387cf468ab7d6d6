# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Four sensors that go on without one: what nobody checks is published no longer than it holds."""

from math import inf, nan, radians

from device import offset, run, SINGULAR
import numpy as np
import pytest
from rig import NAMES, Rig
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.joints import JOINT_NAMES

WRONG = {'th1b': 5.0}


def degraded(samples=100, **settings):
    """Return a rig that goes on without th1B."""
    rig = Rig(degraded='allow', **settings)
    rig.samples(samples, **WRONG)
    assert rig.state == 'degraded: joint_1b excluded'
    return rig


@pytest.mark.parametrize('sensor', range(4))
@pytest.mark.parametrize('size', [4.0, -30.0])
def test_a_sensor_that_stepped_alone_is_left_out_at_once(sensor, size):
    rig = Rig(degraded='allow', alert_limit_deg=5.0)
    jumped = {NAMES[sensor]: size}
    causes = rig.samples(20, **jumped)
    assert None not in causes[:2]
    assert set(causes[3:]) == {None}
    assert rig.left_out == (JOINT_NAMES[sensor],)
    assert max(rig.errors(100, **jumped)) < np.degrees(rig.verdict.protection_level)
    # It is declared that nobody checks it, nor the others.
    assert rig.supervisor.parts == [inf] * 4
    assert min(rig.supervisor.unchecked()) > 0.05
    deviation = sum(rig.verdict.estimate.covariance[::4]) ** 0.5
    assert rig.verdict.protection_level > 5.3 * deviation


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_in_motion_the_error_is_within_the_level_and_the_covariance_larger(sensor):
    found = run(
        'turning',
        seconds=0.8,
        change=offset(500, sensor, 3.0),
        degraded='allow',
        alert_limit_deg=2.0,
    )
    assert found.states[-1] == f'degraded: {JOINT_NAMES[sensor]} excluded'
    assert found.published[503:].all()
    assert found.within_level
    variance = np.trace(found.result.covariance, axis1=1, axis2=2)
    assert np.mean(variance[503:]) > np.nanmean(variance[:500])


def test_a_sensor_that_nobody_can_name_is_silence():
    """It creeps away, until the parity shows that one of them is wrong."""
    rig = Rig(degraded='allow', alert_limit_deg=2.0)
    for index in range(600):
        rig.sample(th1b=0.004 * index)
    assert None not in rig.samples(300, th1b=2.4)
    assert rig.state.endswith('sensor undetermined')


@pytest.mark.parametrize(
    'moved',
    [
        {'th1a': nan},
        {'th1a': inf},
        {'th1b': nan},
    ],
)
def test_fewer_than_three_or_no_numbers_are_silence(moved):
    rig = degraded()
    assert None not in rig.samples(30, **(WRONG | moved))
    assert rig.state.startswith('silent')


def test_the_state_is_not_degraded_while_nothing_is_published():
    rig = degraded()
    rig.supervisor.alert_limit = radians(0.1)
    assert None not in rig.samples(30, **WRONG)
    assert rig.state == 'silent: protection level above the alert limit'
    # Only all sensors together go on behind a place where three are not good enough.
    rig.supervisor.alert_limit = radians(1.0)
    assert None not in rig.samples(30, **WRONG)


@pytest.mark.parametrize(
    ('limits', 'reason', 'between'),
    [
        ({}, 'protection level above the alert limit', (34.0, 39.0)),
        (
            {'deviation_limit_deg': 0.15, 'alert_limit_deg': 3.0},
            'orientation not determined',
            (35.0, 39.0),
        ),
    ],
)
def test_without_th3a_it_stops_before_the_singularity(limits, reason, between):
    phi = SINGULAR - 30.0 + 30.0 * np.sin(2.0 * np.pi * 0.2 * np.arange(1125) * 2e-3)
    rotations = workspace_pose(0.0 * phi, 0.0 * phi, np.radians(phi))
    found = run(
        rotations,
        change=offset(100, 3, 3.0),
        degraded='allow',
        **limits,
    )
    last = np.flatnonzero(found.published)[-1]
    assert between[0] < phi[last] < between[1]
    assert found.within_level
    # It comes back from the singularity without an orientation: only all four can restart.
    assert found.states[-1] == f'silent: {reason}'
    assert found.result.state[-1][0] <= last + 3


@pytest.mark.parametrize('after', [150, 600])
def test_where_the_motion_was_lost_three_sensors_give_no_orientation(after):
    """Which of their solutions is the right one is not known."""
    rig = degraded()
    rig.sample(after=after, **WRONG)
    assert rig.errors(400, **WRONG) == []
    assert rig.state.startswith('silent')
