# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Wrong orientations that were once published, and healthy devices that were once silent."""

from device import encoders, joint_angles, motion, Outcome, SINGULAR, stamps
import numpy as np
import pytest
from spm_haptic_master.kinematics import (
    estimate,
    forward_theta3a,
    quaternion_from_matrix,
    workspace_pose,
)

N = 4000


def outcome(kind, seconds=4.0, rate=1000.0, change=None, noise=0.04, bits=14, **parameters):
    """Return the outcome of a motion whose true angles `change` has made wrong."""
    rotations = motion(kind, seconds, rate)
    angles = joint_angles(rotations)
    if change is not None:
        angles = change(angles.copy())
    return Outcome(rotations, encoders(angles, noise, bits), rate=rate, **parameters)


def turning_half_a_second():
    """Return orientations up to the singularity: a motion that confirms the solution."""
    phi = SINGULAR - 5.0 * (1.0 + np.cos(np.linspace(0.0, np.pi, 500)))
    return workspace_pose(np.zeros(500), np.zeros(500), np.radians(phi))


def from_sample(index, sensor, step_deg):
    def change(angles):
        angles[index:, sensor] += np.radians(step_deg)
        return angles
    return change


# 1. Another solution ------------------------------------------------------------------------

POSE = np.radians([70.871, 117.142, 132.383, -83.875])


def test_a_rival_in_another_working_mode_is_never_taken():
    """Near the locus where Case 2's determinant vanishes a rival explained the angles better."""
    truth = estimate(POSE[:3], POSE[3], 1e-6, prior=workspace_pose(
        np.radians(27.0), 0.0, np.radians(-22.35))).rotation
    readings = encoders(np.tile(POSE, (N, 1)), bits=20)
    run = Outcome(np.broadcast_to(truth, (N, 3, 3)), readings, deviation_limit_deg=5.0,
                  alert_limit_deg=30.0)
    assert np.nanmax(run.error) < 3.0
    assert run.published.mean() > 0.99


# 2. Repeated readings -----------------------------------------------------------------------

@pytest.mark.parametrize('bits', [
    12, pytest.param(14, marks=pytest.mark.evidence), 16,
    pytest.param(17, marks=pytest.mark.evidence)])
@pytest.mark.parametrize('noise', [0.0, 0.005])
@pytest.mark.parametrize('kind', ['singular', 'tremor', 'turning', 'fast'])
def test_a_healthy_quiet_encoder_is_not_frozen(kind, noise, bits):
    run = outcome(kind, 2.0, noise=noise, bits=bits)
    assert run.published[10:].all(), run.states


def test_a_noisy_encoder_that_repeats_itself_is_frozen():
    def stuck(angles):
        return angles
    rotations = motion('crossing', 4.0)
    readings = encoders(joint_angles(stuck(rotations)))
    readings[2000:, 3] = readings[2000, 3]
    run = Outcome(rotations, readings)
    assert not run.published[2030:].any()
    assert any('joint_3a frozen' in state for state in run.states)
    assert np.nanmax(run.error) < 0.25


def test_a_quiet_th3a_stuck_at_the_singularity_is_declared_unchecked():
    rotations = motion('crossing', 20.0)[2000:8000]
    readings = encoders(joint_angles(rotations), noise=0.0)
    readings[2000:, 3] = readings[2000, 3]
    run = Outcome(rotations, readings)
    assert run.longest_undeclared(3) <= 0.02
    # Where the others check it again, it is a fault.
    assert run.states[-1].startswith('silent')


# 3. Systematic errors -----------------------------------------------------------------------

def test_small_systematic_errors_are_not_silent():
    """Zero errors of the size of the nominal bias: no alarm, and the level covers them."""
    wrong = np.radians([0.05, -0.05, 0.05, 0.05])
    run = outcome('sweep', 8.0, change=lambda angles: angles + wrong)
    assert run.published[10:].mean() > 0.999
    assert np.all(run.error[run.published] <= run.result.protection_level[run.published])


# 4. Cold start ------------------------------------------------------------------------------

@pytest.mark.parametrize('change', [
    lambda angles: angles + np.radians([0, 0, 0, 20.0]),
    lambda angles: angles * [1, 1, 1, 2.0],
    lambda angles: angles + np.radians([0, 3.0, 0, 0])])
def test_a_wrong_sensor_before_the_start_is_a_fault_that_stays(change):
    """Consistent for a moment at each crossing of the singularity, it published 14 deg wrong."""
    run = outcome('sweep', 12.0, change=change)
    wrong = run.error > run.result.protection_level
    assert not np.any(wrong & (run.result.unchecked[:, 3] < 1.0))
    assert wrong.sum() < 100
    assert run.states[-1].startswith('silent')


def test_with_start_checked_nothing_is_published_before_every_sensor_was_checked():
    # Half a turn through the place where th3A is checked: the motion confirms the solution.
    run = outcome('through', 4.0, start_checked=True, alert_limit_deg=2.0)
    first = np.flatnonzero(run.published)[0]
    assert np.isfinite(run.result.unchecked[first]).all()
    assert 'silent: joint_3a not checked yet' in run.states
    assert not outcome('singular', 2.0, start_checked=True).published.any()


def test_a_start_near_the_singularity_is_published_at_once():
    assert outcome('crossing', 4.0).published[:].sum() >= N - 20


# 5. Two sensors that cancel -----------------------------------------------------------------

@pytest.mark.parametrize('rate', [250.0, 500.0, 1000.0])
def test_two_sensors_that_jump_and_cancel_in_the_parity_stay_a_fault(rate):
    half = round(2.0 * rate)

    def both(angles):
        angles[half:, 0] += np.radians(2.00)
        angles[half:, 1] -= np.radians(1.87)
        return angles
    run = outcome('rest', 4.0, rate, change=both)
    # Two readings after a step make it certain.
    assert not run.published[half + 2:].any()
    assert 'acknowledged' in run.states[-1]


def test_two_sensors_that_jump_during_another_fault_stay_one_as_well():
    """A disturbance below a jump latches first, and is gone before the two sensors slip."""
    def change(angles):
        angles[2000:2010, :2] += np.radians(0.4)
        angles[2500:, 0] += np.radians(2.00)
        angles[2500:, 1] -= np.radians(1.87)
        return angles
    run = outcome('rest', 4.0, change=change)
    assert not run.published[2000:].any()
    assert 'silent: inconsistent angles, sensor undetermined' in run.states
    assert 'acknowledged' in run.states[-1]


# 6. The closed form's covariance ------------------------------------------------------------

@pytest.mark.parametrize('pose', [(25.0, 30.0, 0.0), (10.0, 200.0, 40.0), (25.0, 100.0, 5.0)])
def test_theta3a_publishes_the_covariance_of_the_closed_form(pose):
    rotation = workspace_pose(*np.radians(pose))
    angles = np.tile(joint_angles(rotation[None]), (2000, 1))
    readings = encoders(angles, bits=24)
    run = Outcome(np.broadcast_to(rotation, (2000, 3, 3)), readings, solver='theta3a',
                  deviation_limit_deg=5.0, alert_limit_deg=20.0)
    out = run.published
    assert out.mean() > 0.95
    found = forward_theta3a(readings[:, :3], readings[:, 3])
    np.testing.assert_allclose(
        np.abs((quaternion_from_matrix(found[out]) * run.result.quaternion[out]).sum(1)), 1.0,
        atol=1e-12)
    rms = np.sqrt(np.mean(run.error[out] ** 2))
    claimed = np.degrees(np.sqrt(np.trace(run.result.covariance[out].mean(0))))
    assert rms == pytest.approx(claimed, rel=0.08)
    assert np.all(run.error[out] <= run.result.protection_level[out])


# 7. Unchecked -------------------------------------------------------------------------------

@pytest.mark.parametrize('change', [
    lambda angles: angles + np.radians([0, 0, 0, 0.1]) * np.arange(len(angles))[:, None] * 1e-3,
    lambda angles: angles * [1, 1, 1, 1.5]])
def test_what_nobody_can_see_at_the_singularity_is_declared(change):
    rotations = np.concatenate([turning_half_a_second(), motion('singular', 4.0)])
    run = Outcome(rotations, encoders(np.concatenate([
        joint_angles(rotations[:500]), change(joint_angles(rotations[500:]))])))
    assert run.published[10:].all()
    assert np.all(run.result.unchecked[500:, 3] > 0.0)
    assert np.all(run.result.unchecked[600:, :3] == 0.0)


def test_the_time_unchecked_grows_from_the_last_check():
    run = outcome('through', 4.0, alert_limit_deg=2.0)
    unchecked = run.result.unchecked[:, 3]
    assert np.isinf(unchecked[:1000]).all()
    assert (unchecked[1990:2010] == 0.0).all()
    last = np.flatnonzero(unchecked == 0.0)[-1]
    assert last < 3000
    assert unchecked[-1] == pytest.approx((len(unchecked) - 1 - last) * 1e-3, abs=2e-3)


def test_a_sensor_unchecked_for_too_long_is_silent():
    rotations = np.concatenate([turning_half_a_second(), motion('singular', 4.0)])
    run = Outcome(rotations, encoders(joint_angles(rotations)), unchecked_limit=2.0)
    assert run.published[10:2000].all()
    assert not run.published[2550:].any()
    assert run.states[-1] == 'silent: joint_3a unchecked for too long'


# 8. Gaps ------------------------------------------------------------------------------------

@pytest.mark.parametrize('missing', [1, 3, 5])
def test_a_step_behind_a_gap_is_seen_at_the_singularity(missing):
    """One lost sample let a step of 1 deg pass, five one of 2 deg."""
    rotations = motion('singular', 4.0)
    angles = joint_angles(rotations)
    angles[2000:, 3] += np.radians(2.0)
    keep = np.ones(N, bool)
    keep[2000 - missing:2000] = False
    run = Outcome(rotations[keep], encoders(angles)[keep], stamps(N)[keep])
    assert np.nanmax(run.error) < 0.25
    assert 'joint_3a jumped' in run.states[-1]


@pytest.mark.parametrize('rate', [100.0, 250.0, 1000.0, 4000.0])
@pytest.mark.parametrize('sensor', range(4))
def test_the_time_to_alert_holds_at_every_rate(rate, sensor):
    count = int(min(3.0 * rate, 4000.0))
    run = outcome('turning', count / rate, rate,
                  change=from_sample(count // 2, sensor, 1.5))
    assert run.longest_undeclared(sensor, rate) <= max(0.02, 10.0 / rate)
    assert not run.published[count * 2 // 3:].any()


# 9. Noise and skew --------------------------------------------------------------------------

@pytest.mark.parametrize('noise', [0.08, 0.12])
def test_more_noise_than_configured_raises_the_level(noise):
    # No sensor becomes unchecked by that, which would take its part out of the level.
    quiet = outcome('turning', 4.0, alert_limit_deg=10.0)
    run = outcome('turning', 4.0, noise=noise, alert_limit_deg=10.0)
    assert run.published[1000:].mean() > 0.99
    assert run.result.protection_level[-1] > 1.2 * quiet.result.protection_level[-1]
    assert np.all(run.error[1000:][run.published[1000:]]
                  <= run.result.protection_level[1000:][run.published[1000:]])


def test_noise_beyond_the_alert_limit_is_silent_and_blames_no_sensor_for_jumping():
    run = outcome('turning', 4.0, noise=0.3)
    assert run.published[1000:].mean() < 0.01
    assert np.all(~(run.error > 1.0))


def test_a_declared_skew_between_encoders_is_allowed_for():
    rotations = motion('fast', 3.0)
    angles = joint_angles(rotations)
    angles[1:, 3] = angles[:-1, 3].copy()
    run = Outcome(rotations, encoders(angles), skew=0.002, alert_limit_deg=3.0)
    assert run.published[10:].mean() > 0.999
