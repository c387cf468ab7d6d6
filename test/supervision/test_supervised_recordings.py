# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded samples through the supervision, in Python: what goes in, and what comes out."""

from device import encoders, joint_angles, motion, SINGULAR, stamps
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SettingError, SpmError
from spm_haptic_master.kinematics import quaternion_from_matrix, workspace_pose
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import supervise, Supervised
from spm_haptic_master.supervision.supervisor import make_supervisor

TIMES = stamps(60)
READINGS = encoders(joint_angles(motion('rest', 0.06)))


@pytest.fixture(scope='module')
def healthy():
    return supervise(TIMES, READINGS)


def test_a_healthy_recording_is_published_after_the_start(healthy):
    assert isinstance(healthy, Supervised)
    assert healthy.published.dtype == bool
    assert list(np.flatnonzero(~healthy.published)) == [0, 1, 2, 3]
    assert healthy.state == [(0, 'starting'), (4, 'healthy')]


def test_what_is_published_is_what_the_supervisor_returns(healthy):
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, {'start_samples': 1}))
    found = supervise(TIMES, READINGS, start_samples=1)
    for index, (stamp, row) in enumerate(zip(TIMES.tolist(), READINGS.tolist(), strict=True)):
        verified = supervisor.take(stamp, tuple(row))
        assert tuple(found.quaternion[index]) == verified.estimate.quaternion
        assert tuple(found.covariance[index].ravel()) == verified.estimate.covariance
        assert np.radians(found.protection_level[index]) == pytest.approx(
            verified.protection_level)
        assert tuple(found.unchecked[index]) == supervisor.unchecked()
    true = quaternion_from_matrix(motion('rest', 0.06))
    assert np.abs((found.quaternion * true).sum(1)).min() > np.cos(np.radians(0.2))
    assert np.all(found.covariance == np.swapaxes(found.covariance, 1, 2))
    assert 0.1 < found.protection_level[-1] < 1.0


def test_what_is_not_published_is_not_a_number(healthy):
    for values, shape in ((healthy.quaternion, (60, 4)), (healthy.covariance, (60, 3, 3)),
                          (healthy.protection_level, (60,))):
        assert values.shape == shape
        assert np.isnan(values[:4]).all()
        assert np.isfinite(values[4:]).all()


def test_unchecked_is_infinite_before_the_first_check(healthy):
    assert healthy.unchecked.shape == (60, 4)
    # A device that rests is never checked: its solution is not confirmed by a motion.
    assert np.isinf(healthy.unchecked).all()


def test_samples_that_are_not_finite_are_rejected_as_by_fkm():
    readings = READINGS.copy()
    readings[30, 2] = np.nan
    readings[40:44, 0] = np.inf
    found = supervise(TIMES, readings)
    withheld = np.flatnonzero(~found.published)
    assert list(withheld) == [0, 1, 2, 3, 30, *range(40, 44)]
    assert np.isnan(found.quaternion[30]).all()
    assert found.reasons['joint_1c missing'] == 1
    assert found.reasons['angle not finite'] == 4


def test_a_silence_of_20_ms_changes_the_state_and_a_shorter_one_does_not():
    readings = READINGS.copy()
    readings[10:20, 0] = np.inf
    readings[30:, 0] = np.inf
    found = supervise(TIMES, readings)
    assert found.state[1:] == [(4, 'healthy'), (49, 'silent: angle not finite')]


def test_a_fault_changes_the_state_at_once():
    readings = READINGS.copy()
    readings[30, 1] += 0.1
    readings[50:, 1] += 0.1
    found = supervise(TIMES, readings)
    assert list(np.flatnonzero(~found.published)) == [0, 1, 2, 3, 30, *range(50, 60)]
    assert found.state[1:] == [(4, 'healthy'), (52, 'silent: joint_1b jumped')]


def test_a_stamp_that_does_not_grow_is_withheld():
    times = TIMES.copy()
    times[30] = times[29]
    found = supervise(times, READINGS)
    assert list(np.flatnonzero(~found.published)) == [0, 1, 2, 3, 30]
    assert found.reasons['sample not newer than the last'] == 1


def test_no_samples_are_a_recording():
    found = supervise(np.zeros(0, int), np.zeros((0, 4)))
    assert (len(found.published), found.state) == (0, [])
    assert found.unchecked.shape == (0, 4)


def test_lists_and_unsigned_stamps_are_arrays():
    found = supervise(TIMES.astype(np.uint64), READINGS.tolist())
    assert found.published.sum() == 56
    assert supervise(TIMES.tolist(), READINGS.tolist()).published.sum() == 56


# Parameters ---------------------------------------------------------------------------------

def test_parameters_are_those_of_fkm():
    assert supervise(TIMES, READINGS, start_samples=20).published.sum() == 41
    assert not supervise(TIMES, READINGS, alert_limit_deg=0.01).published.any()
    levels = [np.nanmax(supervise(TIMES, READINGS, bias_deg=[bias] * 4).protection_level)
              for bias in (0.0, 0.05)]
    assert levels[0] < levels[1]
    assert supervise(TIMES, READINGS, degraded='allow').published.sum() == 56


def test_a_double_underscore_is_a_dot():
    own = supervise(TIMES, READINGS, geometry__alpha_deg=39.3)
    assert own.published.sum() == 56
    assert not supervise(TIMES, READINGS, geometry__alpha_deg=38.0).published.any()


@pytest.mark.parametrize(('parameters', 'text'), [
    ({'sigma': 0.04}, 'sigma'), ({'geometry_alpha_deg': 39.3}, 'geometry_alpha_deg'),
    ({'geometry__alpha': 39.3}, r'geometry\.alpha'),
    ({'sigma_deg': 0.04}, 'sigma_deg'), ({'sigma_deg': [0.04] * 3}, 'sigma_deg'),
    ({'bias_deg': [0.05, 0.05, 0.05, -0.05]}, 'bias_deg'),
    ({'alert_limit_deg': 'small'}, 'alert_limit_deg'), ({'start_checked': 1.5}, 'start_checked'),
    ({'working_mode': [1, 1, 0]}, 'working_mode'), ({'solver': 'best'}, 'solver'),
    ({'joint_min_deg': [200.0] * 4}, 'joint_min_deg')])
def test_a_parameter_that_fkm_does_not_have_is_an_error(parameters, text):
    with pytest.raises(SettingError, match=text) as caught:
        supervise(TIMES, READINGS, **parameters)
    assert '\n' not in str(caught.value)


# Wrong kinds --------------------------------------------------------------------------------

@pytest.mark.parametrize(('times', 'text'), [
    (TIMES * 1e-9, 'float64'), (TIMES[:, None], r'\(60, 1\)'), (TIMES[:59], r'\(60, 4\)'),
    ('now', 'stamps'), (None, 'stamps'), (TIMES.astype(object), 'stamps'),
    (TIMES > 0, 'bool'), (5, r'\(\)'), ([[1], [2, 3]], 'stamps'),
    (TIMES.astype('datetime64[ns]'), 'datetime64'), (TIMES.astype(complex), 'complex')])
def test_stamps_of_another_kind_are_an_error(times, text):
    with pytest.raises(InputError, match=text) as caught:
        supervise(times, READINGS)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('angles', [
    READINGS[:, :3], READINGS[0], READINGS.T, READINGS[None], 'angles', None,
    [*READINGS.tolist()[:-1], [1.0, 2.0]], READINGS.astype(complex), [[None] * 4] * 60,
    [['x'] * 4] * 60, [['0.5'] * 4] * 60, READINGS > 0.0, {}])
def test_angles_of_another_kind_are_an_error(angles):
    with pytest.raises(InputError, match='angles') as caught:
        supervise(TIMES, angles)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('sensors', [3, 7])
def test_another_number_of_sensors_is_refused(sensors):
    angles = np.hstack([READINGS, READINGS])[:, :sensors]
    with pytest.raises(SpmError, match=rf'\(60, {sensors}\): expected \(60, N\)'):
        supervise(TIMES, angles)


def test_the_number_of_sensors_is_that_of_the_angles():
    """Nothing is published from four of six under the name of all."""
    with pytest.raises(SpmError, match="'sensors' is 6; expected 4, as angles have"):
        supervise(TIMES, READINGS, sensors=6)


def test_a_pose_that_nobody_checks_is_declared():
    singular = np.tile(joint_angles(workspace_pose(0.0, 0.0, np.radians(SINGULAR))[None]), (60, 1))
    found = supervise(TIMES, encoders(singular))
    assert found.published[4:].all()
    assert np.isinf(found.unchecked[:, 3]).all()
    assert (found.bounds[4:, 3] > 1.0).all()
    assert (found.bounds[4:, :3] < 1.0).all()


def test_parameters_may_be_of_numpy():
    rotations = motion('turning', 0.1)
    readings = encoders(joint_angles(rotations))
    plain = supervise(stamps(100), readings, bias_deg=[0.1] * 4, alert_limit_deg=2.0)
    other = supervise(stamps(100), readings, bias_deg=np.full(4, 0.1),
                      alert_limit_deg=np.float64(2.0), start_samples=np.int64(5))
    np.testing.assert_array_equal(plain.protection_level, other.protection_level)
    mixed = supervise(stamps(100), readings, bias_deg=[np.float64(0.1)] * 4, alert_limit_deg=2)
    np.testing.assert_array_equal(plain.protection_level, mixed.protection_level)
