# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is declared with an orientation: its protection level, unchecked sensors, cautions."""

from math import degrees, inf, radians, sqrt

from device import run
import numpy as np
import pytest
from rig import Rig


def settled(**settings):
    """Return a rig that all sensors check, and whose window is full."""
    rig = Rig(**{'alert_limit_deg': 2.0} | settings)
    rig.samples(100)
    return rig


def test_the_level_is_the_largest_part_and_that_of_healthy_sensors_at_least():
    """Those: 5.3 standard deviations of the noise, and the nominal biases."""
    rig = settled(bias_deg=(0.0,) * 4)
    assert rig.verdict.protection_level == pytest.approx(max(rig.supervisor.parts))
    deviation = sqrt(sum(rig.verdict.estimate.covariance[::4]))
    assert min(rig.supervisor.parts) > 5.31 * deviation
    # No sensor can be checked within the limit.
    rig.supervisor.alert_limit = 5.31 * deviation
    assert rig.sample().protection_level == pytest.approx(5.3 * deviation, rel=1e-3)
    assert min(rig.supervisor.unchecked()) > 0.0


def test_a_declared_skew_adds_to_the_level_with_the_speed():
    def level(kind, skew):
        found = run(kind, seconds=1.0, skew=skew, alert_limit_deg=10.0)
        return found.level[500:].mean()

    fast = level('fast', 0.003) - level('fast', 0.0)
    rest = level('rest', 0.003) - level('rest', 0.0)
    assert fast > 2.0 * rest > 0.0


@pytest.mark.parametrize(('factor', 'counts'), [(1.15, False), (2.0, True)])
def test_noise_beyond_chance_raises_the_level_and_is_a_caution(factor, counts):
    """Each sensor counts by its own noise."""
    levels = []
    for changed in (1.0, factor):
        rig = settled(alert_limit_deg=10.0)
        rng = np.random.default_rng(3)
        for _ in range(1200):
            rig.sample(th1b=0.04 * sqrt(changed**2 - 1.0) * rng.normal())
        levels.append(rig.verdict.protection_level)
    found = {
        kind: text for kind, text in rig.supervisor.cautions().items() if kind.startswith('noise')
    }
    assert degrees(rig.supervisor.joints.noise()[1]) == pytest.approx(0.04 * factor, rel=0.2)
    if counts:
        assert 1.05 < levels[1] / levels[0] < 2.0
        assert list(found) == ['noise joint_1b']
        assert found['noise joint_1b'].startswith('noise of joint_1b 0.0')
        assert found['noise joint_1b'].endswith('deg, configured 0.04')
    else:
        assert levels[1] == pytest.approx(levels[0], rel=0.02)
        assert found == {}


def test_a_sensor_unchecked_is_a_caution_after_a_second_and_silence_after_the_limit():
    """Until the others check it again."""
    rig = settled(unchecked_limit=1.5)
    assert rig.supervisor.cautions() == {}
    rig.supervisor.alert_limit = 0.99 * max(rig.supervisor.parts)
    assert set(rig.samples(990)) == {None}
    assert rig.supervisor.cautions() == {}
    rig.samples(100)
    assert rig.supervisor.cautions() == {'unchecked joint_1c': 'joint_1c unchecked for 1 s'}
    rig.samples(430)
    assert set(rig.samples(100)) == {'joint_1c unchecked for too long'}
    rig.supervisor.alert_limit = radians(2.0)
    assert set(rig.samples(60)[-20:]) == {None}
    assert rig.supervisor.cautions() == {}
    assert rig.state == 'healthy'


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_at_rest_a_sensor_is_checked_that_has_no_rival(sensors):
    """Of four, th3A has its mirror image beyond the singularity, and th1C another; five none."""
    rig = Rig(sensors, healthy=False, alert_limit_deg=2.0)
    rig.samples(20)
    assert rig.supervisor.unchecked() == (inf,) * sensors
    rig.samples(10)
    checked = [time == 0.0 for time in rig.supervisor.unchecked()]
    assert checked == [True, True, sensors > 4, sensors > 4, True, True][:sensors]
    rig.samples(1000)
    assert rig.state == 'healthy'
    cautions = list(rig.supervisor.cautions().values())
    unchecked = ['joint_1c unchecked since the start', 'joint_3a unchecked since the start']
    assert cautions == unchecked * (sensors == 4)
