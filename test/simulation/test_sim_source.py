# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders: reproducible, noisy as asked, quantised, within reach, on their grid."""

from math import pi, radians
import time

from encoder_frames import values
import numpy as np
import pytest

from spm_haptic_master.encoders.deadline_grid import Grid
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import inverse, matrix_from_zxz
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.source_factory import make_source

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


@pytest.mark.parametrize('tilt_deg', [0.0, 13.0, 20.0, 26.0])
def test_the_sweep_stays_within_reach_over_whole_periods(tilt_deg):
    """All of 7 x 11 x 17 s, and the tilt asked for is reached and not passed."""
    at = trajectories.sweep(radians(tilt_deg))
    poses = np.array([at(t) for t in np.arange(0.0, 1309.0, 0.05)])
    rotations = matrix_from_zxz(*poses.T)
    joints = inverse(rotations)
    assert np.isfinite(joints.theta1).all()
    assert np.isfinite(joints.theta3a).all()
    tilt = np.degrees(np.arccos(np.clip(rotations[:, :, 2].sum(axis=1) / np.sqrt(3.0), -1.0, 1.0)))
    assert tilt.max() == pytest.approx(tilt_deg, abs=0.01)
    assert np.degrees(poses[:, 2].min()) == pytest.approx(10.0, abs=0.1)
    assert np.degrees(poses[:, 2].max()) == pytest.approx(40.0, abs=0.1)


def test_a_fixed_pose_stands_still_and_has_to_be_within_reach():
    got = angles(TIMES[:10], sim__trajectory='fixed', sim__noise_deg=0.0)
    assert np.ptp(got, axis=0).max() == 0.0
    with pytest.raises(SettingError, match="'sim.pose_deg' .* expected a pose within reach"):
        make_source('sim', values('sim', sim__trajectory='fixed', sim__pose_deg=(0.0, 0.0, 0.0)))


def test_a_grid_counts_what_it_missed_and_never_drifts():
    grid = Grid(0.01)
    began = time.monotonic()
    for _ in range(5):
        assert grid.wait(1.0)
    missed_before = grid.missed
    time.sleep(0.055)
    assert grid.wait(1.0)
    # 55 ms asleep right after a deadline: four to six of the next ones passed.
    assert 4 <= grid.missed - missed_before
    while grid.wait(1.0) and time.monotonic() - began < 0.3:
        pass
    taken = time.monotonic() - began
    # Where it stands now is on the grid that began with the first wait.
    assert 0.0 <= taken % 0.01 < 0.009 or grid.missed > missed_before


def test_a_grid_tells_when_the_deadline_is_far():
    grid = Grid(10.0)
    assert grid.wait(0.0)
    began = time.monotonic()
    assert not grid.wait(0.02)
    assert time.monotonic() - began < 1.0


def test_read_gives_samples_at_the_rate():
    source = make_source('sim', values('sim', rate=200.0))
    got = [sample for _ in range(100) if (sample := source.read(1.0))]
    assert len(got) == 100
    span = (got[-1].stamp - got[0].stamp) * 1e-9
    missed = source.statistics()['missed deadlines']
    assert span == pytest.approx((99 + missed) / 200.0, abs=0.02)
    assert source.fault is None
