# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders: reproducible, with the given noise, quantised, at the given rate."""

from math import isnan, pi

from encoder_frames import values
import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import inverse, matrix_from_zxz
from spm_haptic_master.nodes.source_factory import make_source
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.fault_injection import parse_switched

COUNT = 2.0 * pi / 16384


def angles(times, **overrides):
    source = make_source('sim', values('sim', **overrides))
    return np.array([source.angles(t) for t in times])


TIMES = np.linspace(0.0, 20.0, 4001)


def test_the_same_seed_gives_the_same_noise():
    assert np.array_equal(angles(TIMES[:100], sim__seed=3), angles(TIMES[:100], sim__seed=3))
    assert not np.array_equal(angles(TIMES[:100], sim__seed=3), angles(TIMES[:100], sim__seed=4))


def test_noise_has_its_sigma_and_is_independent():
    error = np.degrees(angles(TIMES, sim__noise_deg=0.2) - angles(TIMES, sim__noise_deg=0.0))
    np.testing.assert_allclose(error.std(axis=0), 0.2, rtol=0.05)
    assert np.abs(error.mean(axis=0)).max() < 0.02
    assert np.abs(np.corrcoef(error.T) - np.eye(4)).max() < 0.06


def test_angles_lie_on_the_counts_grid():
    counts = angles(TIMES[:200]) / COUNT
    assert np.abs(counts - counts.round()).max() < 1e-6


def test_without_noise_it_is_the_inverse_model():
    got = angles(TIMES[::40], sim__noise_deg=0.0)
    poses = np.array([trajectories.fig9(t) for t in TIMES[::40]])
    joints = inverse(matrix_from_zxz(*poses.T))
    true = np.column_stack([joints.theta1, joints.theta3a])
    assert np.abs(got - true).max() <= COUNT / 2 + 1e-12


def test_a_fixed_pose_does_not_move_and_has_to_be_within_reach():
    got = angles(TIMES[:10], sim__trajectory='fixed', sim__noise_deg=0.0)
    assert np.ptp(got, axis=0).max() == 0.0
    with pytest.raises(SettingError, match="'sim.pose_deg' .* expected a pose within reach"):
        make_source('sim', values('sim', sim__trajectory='fixed', sim__pose_deg=(0.0, 0.0, 0.0)))


def test_read_returns_samples_at_the_rate():
    source = make_source('sim', values('sim', rate=200.0))
    got = [sample for _ in range(100) if (sample := source.read(1.0))]
    assert len(got) == 100
    span = (got[-1].stamp - got[0].stamp) * 1e-9
    missed = source.statistics()['missed deadlines']
    assert span == pytest.approx((99 + missed) / 200.0, abs=0.02)
    assert source.fault is None


@pytest.mark.parametrize(('sensors', 'gone', 'goes_on'), [
    (4, ['joint_3a'], False), (5, ['joint_3b'], True), (6, ['joint_1a', 'joint_3c'], True),
    (6, ['joint_1a', 'joint_3b', 'joint_3c'], False)])
def test_encoders_that_do_not_answer_have_no_reading(sensors, gone, goes_on):
    source = make_source('sim', values('sim', sensors=sensors, rate=200.0))
    source.faults = tuple(parse_switched(f'dropout:{joint}', sensors) for joint in gone)
    sample = source.read(1.0)
    text = f'no answer of {", ".join(gone)}'
    if goes_on:
        missing = [joint for joint, angle in zip(ALL_JOINT_NAMES, sample.angles, strict=False)
                   if isnan(angle)]
        assert (missing, source.fault, source.caution) == (gone, None, text)
    else:
        assert (sample, source.fault, source.caution) == (None, text, None)
