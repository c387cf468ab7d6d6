# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is declared with an orientation: its protection level, unchecked sensors, cautions."""

from math import degrees, inf, radians, sqrt

from device import encoders, joint_angles, motion, Outcome, SINGULAR
import numpy as np
import pytest
from rig import Rig
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.supervision.exposure import UNCONFIRMED
from spm_haptic_master.supervision.symptom import Reason

# Where th3A alone carries the orientation.
AT_SINGULARITY = (0.0, 0.0, SINGULAR)


def settled(**settings):
    """Return a rig that all sensors check, and whose window is full."""
    rig = Rig(**{'alert_limit_deg': 2.0} | settings)
    rig.samples(100)
    return rig


# The protection level -----------------------------------------------------------------------

def test_the_level_is_the_largest_part_of_a_sensor_that_is_within_the_alert_limit():
    rig = settled()
    *_, below, largest = sorted(rig.supervisor.parts)
    assert rig.verdict.protection_level == pytest.approx(largest)
    # One sensor cannot be checked within the limit: it is not in the level.
    rig.supervisor.alert_limit = 0.5 * (below + largest)
    rig.sample()
    assert rig.verdict.protection_level == pytest.approx(below, rel=0.01)
    times = rig.supervisor.unchecked()
    assert times.index(max(times)) == rig.supervisor.parts.index(max(rig.supervisor.parts))
    assert max(times) == pytest.approx(1e-3)


def test_without_a_part_within_the_limit_it_is_what_healthy_sensors_do():
    """5.3 standard deviations of the noise, and the nominal biases."""
    rig = settled(bias_deg=(0.0,) * 4)
    deviation = sqrt(sum(rig.verdict.estimate.covariance[::4]))
    assert min(rig.supervisor.parts) > 5.31 * deviation
    rig.supervisor.alert_limit = 5.31 * deviation
    assert rig.sample().protection_level == pytest.approx(5.3 * deviation, rel=1e-3)
    assert min(rig.supervisor.unchecked()) > 0.0


def test_the_level_falls_while_the_window_fills():
    rig = settled()
    before = rig.verdict.protection_level
    rig.sample(after=600)
    levels = [rig.sample().protection_level for _ in range(100)]
    first = levels[4]
    assert first > 1.1 * before
    assert levels[-1] == pytest.approx(before, rel=0.01)


def test_another_method_adds_its_distance_to_every_part():
    usual, theta3a = settled(), settled(solver='theta3a')
    apart = rotation_distance(usual.verdict.estimate.quaternion,
                              theta3a.verdict.estimate.quaternion)
    assert apart > radians(0.01)
    # Beside its larger deviation.
    deviations = [5.3 * sqrt(sum(rig.verdict.estimate.covariance[::4])) for rig in (
        usual, theta3a)]
    added = np.array(theta3a.supervisor.parts) - usual.supervisor.parts
    assert added == pytest.approx(apart + deviations[1] - deviations[0], rel=1e-3)


def test_the_alert_limit_is_live():
    rig = settled()
    rig.supervisor.alert_limit = radians(0.1)
    verdict = rig.sample()
    assert verdict.estimate is None
    assert verdict.cause.reason is Reason.UNPROTECTED
    assert verdict.cause.detail.endswith('deg, limit 0.1')
    assert verdict.protection_level == inf
    rig.supervisor.alert_limit = radians(2.0)
    assert rig.samples(30) == [None] * 30


def test_a_declared_skew_adds_to_the_level_with_the_speed():
    def added(kind):
        rotations = motion(kind, 1.0)
        levels = [Outcome(rotations, encoders(joint_angles(rotations)), skew=skew,
                          alert_limit_deg=10.0).result.protection_level[500:].mean()
                  for skew in (0.0, 0.003)]
        return levels[1] - levels[0]

    assert added('fast') > 2.0 * added('rest') > 0.0


@pytest.mark.parametrize(('factor', 'counts'), [(1.15, False), (2.0, True)])
def test_noise_beyond_chance_raises_the_level_and_is_a_caution(factor, counts):
    """Each sensor counts by its own noise."""
    levels = []
    for changed in (1.0, factor):
        rig = settled(alert_limit_deg=10.0)
        rng = np.random.default_rng(3)
        for _ in range(2500):
            rig.sample(th1b=0.04 * sqrt(changed**2 - 1.0) * rng.normal())
        levels.append(rig.verdict.protection_level)
    found = {kind: text for kind, text in rig.supervisor.cautions().items()
             if kind.startswith('noise')}
    assert degrees(rig.supervisor.joints.noise()[1]) == pytest.approx(0.04 * factor, rel=0.2)
    if counts:
        assert 1.05 < levels[1] / levels[0] < 2.0
        assert list(found) == ['noise joint_1b']
        assert found['noise joint_1b'].startswith('noise of joint_1b 0.0')
        assert found['noise joint_1b'].endswith('deg, configured 0.04')
    else:
        assert levels[1] == pytest.approx(levels[0], rel=0.02)
        assert found == {}


def test_noise_that_makes_the_level_too_high_is_the_reason_of_silence():
    rotations = motion('rest', 2.0)
    assert Outcome(rotations, encoders(joint_angles(rotations)),
                   alert_limit_deg=0.4).published[10:].all()
    noisy = Outcome(rotations, encoders(joint_angles(rotations), noise=0.1), alert_limit_deg=0.4)
    assert not noisy.published[1000:].any()
    assert noisy.states[-1] == 'silent: protection level above the alert limit'


# Unchecked sensors --------------------------------------------------------------------------

def test_a_sensor_unchecked_for_more_than_a_second_is_a_caution():
    rig = settled()
    assert rig.supervisor.cautions() == {}
    rig.supervisor.alert_limit = 0.99 * max(rig.supervisor.parts)
    worst = JOINT_NAMES[rig.supervisor.parts.index(max(rig.supervisor.parts))]
    rig.samples(990)
    assert rig.supervisor.cautions() == {}
    rig.samples(1200)
    assert rig.supervisor.cautions() == {f'unchecked {worst}': f'{worst} unchecked for 2 s'}
    rig.supervisor.alert_limit = radians(2.0)
    rig.samples(30)
    assert rig.supervisor.cautions() == {}


def test_that_none_was_ever_checked_is_one_caution_at_once():
    rig = Rig(pose=AT_SINGULARITY, healthy=False)
    rig.samples(30)
    assert list(rig.supervisor.cautions().values()) == [UNCONFIRMED]


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_no_sensor_is_checked_before_the_device_has_moved_by_some_degrees(sensors):
    """Four may fit another orientation by chance; more need no motion."""
    rig = Rig(sensors, healthy=False, alert_limit_deg=2.0)
    rig.samples(500)
    assert rig.state == 'healthy'
    assert rig.supervisor.unchecked() == ((inf,) * 4 if sensors == 4 else (0.0,) * sensors)


def test_a_sample_with_a_symptom_checks_no_sensor():
    """A window of consistent samples has to follow."""
    rig = settled()
    assert rig.supervisor.unchecked() == (0.0,) * 4
    assert rig.sample(th1c=5.0).estimate is None
    assert rig.supervisor.unchecked() == pytest.approx((1e-3,) * 4)
    assert rig.samples(20) == [None] * 20
    assert rig.supervisor.unchecked() == pytest.approx((21e-3,) * 4)
    rig.samples(2)
    assert rig.supervisor.unchecked() == (0.0,) * 4


def test_a_restart_forgets_what_was_checked():
    rig = settled()
    rig.sample(after=501)
    assert rig.supervisor.unchecked() == (inf,) * 4


@pytest.mark.parametrize('limit', [0.5, 2.0])
def test_unchecked_for_longer_than_the_limit_is_silence(limit):
    """Counted from the start where no sensor was checked."""
    rig = Rig(pose=AT_SINGULARITY, healthy=False, unchecked_limit=limit)
    count = round(limit * 1e3)
    assert rig.samples(count)[5:] == [None] * (count - 5)
    causes = rig.samples(100)
    assert set(causes[2:]) == {f'{JOINT_NAMES[0]} unchecked for too long'}
    assert rig.state == 'silent: joint_1a unchecked for too long'


def test_unchecked_for_too_long_ends_where_the_others_check_it_again():
    rig = settled(unchecked_limit=0.1)
    rig.supervisor.alert_limit = 0.99 * max(rig.supervisor.parts)
    causes = rig.samples(150)
    assert set(causes[:90]) == {None}
    assert set(causes[110:]) == {'joint_1c unchecked for too long'}
    rig.supervisor.alert_limit = radians(2.0)
    assert set(rig.samples(60)[-20:]) == {None}
    assert rig.state == 'healthy'


def test_without_a_limit_it_may_last():
    rig = Rig(pose=AT_SINGULARITY, healthy=False, unchecked_limit=0.0)
    assert set(rig.samples(3000)[5:]) == {None}


# Checked before the start -------------------------------------------------------------------

@pytest.mark.parametrize(('pose', 'words'), [
    ((8.0, 30.0, 20.0), ''),
    (AT_SINGULARITY, 'joint_3a not checked yet: '
     'turn the handle about its axis, away from the singularity')])
def test_with_start_checked_nothing_is_published_before_every_sensor_was_checked(pose, words):
    rig = Rig(5 if words == '' else 4, pose=pose, healthy=False, start_checked=True)
    causes = rig.samples(100)
    assert set(causes[:20]) >= {'starting'}
    assert None not in causes[:20]
    if words:
        assert None not in causes
    else:
        assert set(causes[30:]) == {None}
        assert rig.supervisor.unchecked() == (0.0,) * 5
