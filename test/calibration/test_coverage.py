# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What bias_deg promises: no sensor is off by more, at any pose of the region of the file."""

from dataclasses import replace
from math import radians, tau

import free_motions
import numpy as np
import pytest
from simulated_hand import readings
from spm_haptic_master.calibration.motion import coverage
from spm_haptic_master.calibration.watch import slip_evidence
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.simulation.rig import random_rig
from spm_haptic_master.validation.parity_map import tilt_and_turn


@pytest.mark.slow
@pytest.mark.parametrize(
    'number, changes',
    [
        (0, {'seconds': 15.0}),
        (0, {'tilt': 5.0, 'seconds': 40.0}),
        pytest.param(1, {'seconds': 40.0}, marks=pytest.mark.evidence),
    ],
)
def test_no_sensor_is_off_by_more_than_its_bias(number, changes):
    """Neither over the workspace, where a motion of small tilts says little, nor where it went."""
    rig = random_rig(number, free_motions.DEVIATIONS)
    stamps, raw, direction, zeros = readings(
        rig,
        replace(free_motions.SHORT, **changes),
        100 * number + 7,
    )
    found = free_motions.calibrated(
        stamps[::5],
        raw[::5],
        direction,
        zeros,
    )
    for each in (found, replace(found, region=coverage.region_of(found.rotation))):
        assert (free_motions.sensor_errors(each, rig, zeros) <= each.bias).all()


def test_the_bound_covers_what_the_covariance_draws_and_the_mechanism_turns():
    """Errors of zeros and harmonics drawn by it: a twentieth are beyond two deviations at most."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 3)
    random = np.random.default_rng(4)
    count = model.layout.count
    half = 1e-3 * random.normal(size=(count, count)) / np.sqrt(count)
    there = coverage.WORKSPACE.poses(model, vector)
    bound = coverage.sensor_bounds(
        model,
        vector,
        half @ half.T,
        there,
        np.zeros(4),
    )
    angles = model.joint_angles(there, model.layout.geometry(vector))
    read = model.readings(there, vector)
    beyond = []
    for _ in range(200):
        off = vector + half @ random.normal(size=len(vector))
        # The mechanism known: its errors are no sensor's.
        off[4:16] = vector[4:16]
        differences = model.corrected(read, off) - angles
        errors = np.angle(np.exp(1j * differences))
        beyond.append((np.abs(errors) > bound).any(axis=0))
    assert np.mean(beyond) < 0.1
    wider = coverage.sensor_bounds(
        model,
        vector,
        half @ half.T,
        there,
        np.array([0.0, 0.01, 0.0, 0.0]),
    )
    assert wider[1] > bound[1] + 0.009
    # Where links alone are unknown, the bounds cover what they do to the orientation.
    deviations = np.zeros(model.layout.count)
    deviations[:4] = radians(0.001)
    few = coverage.sensor_bounds(
        model,
        vector,
        np.diag(deviations**2),
        there,
        np.zeros(4),
    )
    deviations[4:10] = radians(0.2)
    many = coverage.sensor_bounds(
        model,
        vector,
        np.diag(deviations**2),
        there,
        np.zeros(4),
    )
    assert (many > 5.0 * few).all()


def test_what_a_motion_showed_bounds_the_parity_far_below_the_sensors_bounds():
    """Rigs drawn by the covariance of a calibration: their parity over the region of its file."""
    found = free_motions.short_calibration()
    poses = coverage.WORKSPACE.poses(found.model, found.vector)
    unweighted = replace(found.model, sigma=np.ones(4))
    values, vectors = np.linalg.eigh(found.covariance)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    random = np.random.default_rng(4)
    largest = []
    for _ in range(40):
        rig = found.vector + half @ random.normal(size=len(values))
        read = unweighted.readings(poses, rig)
        turned = read[np.isfinite(read).all(axis=1)]
        there = unweighted.orientations(turned, found.vector)
        linear = unweighted.linearised(turned, there, found.vector)
        largest.append(np.abs(linear.parity).max())
    assert np.mean(np.array(largest) > found.parity_bias) < 0.1
    assert max(largest) < 1.3 * found.parity_bias
    assert found.parity_bias < 0.3 * found.bias.max()


def test_the_region_of_a_motion_is_within_it():
    seconds = np.linspace(0.0, 60.0, 6000)
    rotation = workspace_pose(
        np.radians(12.4) * np.abs(np.sin(seconds)),
        2.3 * seconds,
        np.radians(170.0 + 30.3 * np.sin(0.7 * seconds)),
    )
    rotation[:100] = np.nan
    found = coverage.region_of(rotation)
    assert 11.0 <= found.tilt_deg <= 12.4
    assert 139.7 <= found.from_deg <= 142.0
    assert 198.0 <= found.to_deg <= 200.3
    assert found.is_large
    assert coverage.Region(8.0, 30.0, 50.0).is_large
    assert not coverage.Region(7.9, 0.0, 80.0).is_large
    assert not coverage.Region(16.0, 30.0, 49.0).is_large


def test_a_region_leaves_out_a_fortieth_of_a_motion_at_either_edge():
    """Tilts to 20.4 deg, turns from 30.3 to 130.3 deg, evenly: to whole degrees inside."""
    number = np.arange(4001)
    part = number / 4000.0
    rotation = workspace_pose(
        np.radians(20.4 * part),
        2.0 * number,
        np.radians(30.3 + 100.0 * (number * 0.618 % 1.0)),
    )
    found = coverage.region_of(rotation)
    # 95 % of the tilts, and of the turns from 2.5 to 97.5 %.
    assert found == coverage.Region(
        tilt_deg=19.0,
        from_deg=33.0,
        to_deg=127.0,
    )
    assert found.text == 'tilt to 19 deg, self-rotation 33 to 127 deg'


def test_angles_around_their_middle_do_not_jump():
    angles = np.array([3.0, -3.1, np.nan, 3.1, 2.9, -2.9])
    found = coverage.around_middle(angles)
    assert np.nanmax(found) - np.nanmin(found) == pytest.approx(tau - 2.9 - 2.9)
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angles))
    middle = np.angle(np.nansum(np.exp(1j * angles)))
    assert np.nanmax(np.abs(found - middle)) < np.pi
    np.testing.assert_allclose(coverage.around_middle(np.array([0.3, 0.5])), [0.3, 0.5])


def test_a_region_is_looked_at_in_twelve_directions_at_three_tilts_and_five_turns():
    model = free_motions.model_of()
    region = coverage.Region(
        tilt_deg=14.0,
        from_deg=10.0,
        to_deg=70.0,
    )
    poses = region.poses(model, np.zeros(model.layout.count))
    tilts, turns = (np.degrees(part).round(6) for part in tilt_and_turn(poses))
    assert sorted(set(turns)) == [10.0, 25.0, 40.0, 55.0, 70.0]
    assert sorted(set(tilts)) == [0.0, 7.0, 14.0]
    # Without a tilt there is one direction.
    assert len(poses) == 5 * (1 + 2 * 12)
    assert len(np.unique(poses.round(9), axis=0)) == len(poses)
    far = coverage.Region(
        tilt_deg=80.0,
        from_deg=10.0,
        to_deg=70.0,
    )
    angles = model.joint_angles(
        far.poses(model, np.zeros(model.layout.count)), model.layout.nominal
    )
    assert 0 < len(angles) < len(poses)
    assert np.isfinite(angles).all()


@pytest.mark.parametrize('azimuth', coverage.AZIMUTHS)
def test_a_tilt_is_named_by_the_motor_that_is_nearest_or_just_opposite(azimuth):
    """Motor A is on z, B on x, C on y."""
    tilted = workspace_pose(0.1, azimuth, 0.0)[:, 2] - workspace_pose(0.0, 0.0, 0.0)[:, 2]
    towards = {'A': tilted[2], 'B': tilted[0], 'C': tilted[1]}
    nearest = max(towards, key=towards.get)
    farthest = min(towards, key=towards.get)
    is_opposite = -towards[farthest] > 1.5 * towards[nearest]
    expected = f"away from leg {farthest}'s" if is_opposite else f"towards leg {nearest}'s"
    assert coverage._towards(azimuth) == f'{expected} motor'


def test_the_covariance_is_the_inverse_whatever_the_units():
    """Also of parameters that are known a trillion times as well as others."""
    random = np.random.default_rng(3)
    half = random.normal(size=(5, 5))
    information = half @ half.T + np.eye(5)
    units = np.array([1e-4, 1e-2, 1.0, 1e4, 1e8])
    found = coverage.inverse(information * units[:, None] * units)
    expected = np.linalg.inv(information) / units[:, None] / units
    np.testing.assert_allclose(
        found,
        expected,
        rtol=1e-8,
    )
    # What nothing determines is known badly, and changes nothing of the rest.
    alone = np.zeros((6, 6))
    alone[:5, :5] = information
    found = coverage.inverse(alone)
    np.testing.assert_allclose(
        found[:5, :5],
        np.linalg.inv(information),
        rtol=1e-8,
    )
    assert 1e10 < found[5, 5] < np.inf
    difference = np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert 1e10 < coverage.inverse(difference)[0, 0] < np.inf


def test_errors_of_orientations_are_the_root_of_their_mean_squares():
    """Of what parameters drawn by the covariance turn the poses by."""
    random = np.random.default_rng(4)
    changes = random.normal(size=(6, 3, 5))
    half = 1e-3 * random.normal(size=(5, 5))
    covariance = half @ half.T
    every = np.einsum('nip,pq,niq->ni', changes, covariance, changes)
    np.testing.assert_allclose(coverage.variances(changes, covariance), every)
    expected = np.sqrt(np.mean(every.sum(axis=1)))
    assert coverage.orientation_error(changes, covariance) == pytest.approx(expected)


@pytest.mark.parametrize('same', [False, True])
def test_a_rotation_that_all_poses_share_is_no_error(same):
    """Of the base or of the platform: least squares take it away."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 3)
    poses = free_motions.poses(40)[:8]
    if same:
        poses = np.repeat(poses[:1], 8, axis=0)
    found = coverage.aligned_changes(model, poses, vector)
    changes = model.orientation_changes(poses, vector)
    of_frames = np.concatenate([np.concatenate([np.eye(3), pose], axis=1) for pose in poses])
    for column in range(0, model.layout.count, 3):
        wanted = changes[:, :, column].ravel()
        taken = of_frames @ np.linalg.lstsq(of_frames, wanted, rcond=1e-9)[0]
        np.testing.assert_allclose(
            found[:, :, column].ravel(),
            wanted - taken,
            atol=1e-7,
        )


def bounds_of(deviations, unexplained=(0.0, 0.0, 0.0, 0.0)):
    """Return the bounds by parameters with these deviations, rad, after what they are of."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 3)
    covariance = np.diag(np.asarray(deviations) ** 2)
    poses = coverage.WORKSPACE.poses(model, vector)
    bounds = coverage.sensor_bounds(
        model,
        vector,
        covariance,
        poses,
        np.array(unexplained),
    )
    return model, vector, covariance, poses, bounds


def test_bounds_of_zeros_alone_are_two_and_a_half_deviations_to_a_hundredth_of_a_degree():
    deviations = np.zeros(32)
    deviations[:4] = np.radians([0.0201, 0.0199, 0.04, 0.083])
    *_, bounds = bounds_of(deviations, np.radians([0.0, 0.0, 0.005, 0.01]))
    # 0.0503, 0.0498, 0.105, 0.2175 deg, rounded up.
    np.testing.assert_allclose(np.degrees(bounds), [0.06, 0.05, 0.11, 0.22])


def test_bounds_of_a_harmonic_are_those_at_the_worst_pose():
    deviations = np.zeros(32)
    model = free_motions.model_of()
    sine_of_first = model.layout.columns('first harmonics')[1]
    deviations[sine_of_first] = radians(1.0)
    model, vector, _, poses, bounds = bounds_of(deviations)
    angles = model.joint_angles(poses, model.layout.geometry(vector))[:, 0]
    worst = np.ceil(250.0 * np.abs(np.sin(angles)).max()) / 100.0
    np.testing.assert_allclose(
        np.degrees(bounds),
        [worst, 0.0, 0.0, 0.0],
        atol=1e-9,
    )


def test_bounds_are_raised_until_they_cover_the_errors_of_links_and_no_farther():
    """At the worst pose the bounds together turn the orientation as far as these errors."""
    deviations = np.zeros(32)
    deviations[:4] = radians(0.05)
    deviations[4:16] = radians(0.3)
    model, vector, covariance, poses, bounds = bounds_of(deviations)
    assert (bounds > 1.5 * radians(0.125)).all()
    np.testing.assert_allclose(bounds / coverage.UNIT, np.rint(bounds / coverage.UNIT))
    by_links = coverage.aligned_changes(model, poses, vector)
    by_zeros = model.orientation_changes(poses, vector)[:, :, :4]
    turned = [np.sqrt(np.trace(each @ covariance @ each.T)) for each in by_links]
    allowed = [np.linalg.norm(each, axis=0) @ bounds for each in by_zeros]
    assert 0.96 < 2.5 * np.max(np.divide(turned, allowed)) <= 1.0


def test_the_bound_of_the_parity_is_that_of_the_worst_pose():
    """Of the zeros of two sensors that are wrong alike, and what no parameter explains."""
    model = free_motions.model_of()
    vector = np.zeros(model.layout.count)
    poses = coverage.WORKSPACE.poses(model, vector)
    wrong = np.zeros(model.layout.count)
    wrong[:2] = radians(0.1)
    bound = coverage.parity_bound(
        model,
        vector,
        np.outer(wrong, wrong),
        poses,
        radians(0.034),
    )
    *_, rates = slip_evidence.reached(
        poses,
        model.layout.nominal,
        (1, 1, 1),
        4,
    )
    # The direction that no rotation explains is orthogonal to the columns of the Jacobian.
    across = np.array([np.linalg.svd(each)[0][:, 3] for each in rates])
    largest = np.abs(across @ [0.1, 0.1, 0.0, 0.0]).max()
    assert np.degrees(bound) == pytest.approx(np.ceil(100.0 * (2.5 * largest + 0.034)) / 100.0)


def test_further_motions_are_told_by_what_they_gain():
    """What a motion adds is more with a higher rate, and it is least for what is known well."""
    model = free_motions.model_of()
    vector = np.zeros(model.layout.count)
    poses = coverage.WORKSPACE.poses(model, vector)
    changes = coverage.aligned_changes(model, poses, vector)
    before = np.diag(model.layout.deviations**-2.0) + 1e4 * np.eye(model.layout.count)

    def gains(information, rate):
        return coverage.further_motions(
            model,
            vector,
            information,
            rate,
            changes,
        )

    found = gains(before, 100.0)
    assert list(found.values()) == sorted(found.values(), reverse=True)
    legs = [f"{way} leg {leg}'s motor" for way in ('towards', 'away from') for leg in 'ABC']
    assert set(found) == {
        *(f'tilt the handle farther {leg}' for leg in legs),
        'turn the handle farther to the right (clockwise)',
        'turn the handle farther to the left (counter-clockwise)',
    }
    assert min(found.values()) > 1.0
    more = gains(before, 200.0)
    assert all(more[text] > gain for text, gain in found.items())
    # Twice the rate of what is known twice as well is as much.
    both = gains(2.0 * before, 200.0)
    assert both == pytest.approx(found)
    assert max(gains(1e9 * before, 100.0).values()) == pytest.approx(1.0, abs=1e-3)
