# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientations from outside: least squares with the motion's result as what is known before."""

from dataclasses import replace
from math import radians
from types import SimpleNamespace

import free_motions
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import outside_reference
from spm_haptic_master.calibration.motion.outside_reference import mounted
from spm_haptic_master.exceptions import CalibrationError, GeometryError
from spm_haptic_master.kinematics import matrix_from_zxz, workspace_pose
from spm_haptic_master.kinematics.rotations import matrix_from_vector
from spm_haptic_master.validation.alignment import rotation_vectors

BASE = matrix_from_zxz(0.3, 0.2, -0.5)
HANDLE = matrix_from_zxz(1.0, 0.4, 2.0)
SIGMA = radians(0.05)


@pytest.fixture(scope='module')
def calibration():
    """Return a stand-in for a calibration: model, parameters, and what a motion leaves of them."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 5)
    random = np.random.default_rng(2)
    count = model.layout.count
    half = radians(0.1) * random.normal(size=(count, count)) / np.sqrt(count)
    return Result(
        model=model,
        vector=vector,
        covariance=half @ half.T + radians(0.02) ** 2 * np.eye(count),
    )


class Result(SimpleNamespace):
    """The part of a calibration from free motion that is read."""


def poses_and_readings(
    calibration,
    count,
    noise,
    seed=3,
):
    """Return readings, and poses from outside with noise, rad, of a rig near the calibration."""
    random = np.random.default_rng(seed)
    tilt = random.uniform(0.0, 0.25, count)
    azimuth = random.uniform(0.0, 6.28, count)
    poses = workspace_pose(
        tilt,
        azimuth,
        random.uniform(0.3, 1.3, count),
    )
    true = calibration.vector + 0.5 * np.sqrt(np.diag(calibration.covariance))
    turned = calibration.model.readings(poses, true)
    errors = matrix_from_vector(noise * random.normal(size=(count, 3)))
    return turned, errors @ BASE @ poses @ HANDLE


@pytest.fixture
def fuse(monkeypatch, calibration):
    """Return what fuses a calibration with poses; the rest of its figures stays."""

    def fused(
        calibration,
        vector,
        covariance,
    ):
        return Result(
            model=calibration.model,
            vector=vector,
            covariance=covariance,
        )

    monkeypatch.setattr(
        outside_reference,
        '_fused',
        fused,
    )
    return lambda turned, outside: mounted(
        calibration,
        turned,
        outside,
        SIGMA,
    )


def linearised(
    calibration,
    turned,
    outside,
    found,
    both,
):
    """Return errors and their changes at a result."""
    now = outside_reference._Frames(
        found.calibration.vector,
        found.base,
        found.handle,
    )
    rotation = calibration.model.orientations(turned, now.vector)
    return outside_reference._linearised(
        calibration.model,
        rotation,
        outside,
        now,
        both,
    )


@pytest.mark.parametrize('count', [1, 2, 3, 20])
def test_the_result_is_the_least_of_what_the_motion_and_the_poses_leave(
    fuse,
    calibration,
    count,
):
    """There the gradient of the sum of squares is 0, and its curvature gives the deviations."""
    turned, outside = poses_and_readings(calibration, count, SIGMA)
    both = count >= 3
    if not both:
        # So few say nothing of the handle: of a jig that holds it as the platform.
        outside = outside @ HANDLE.T
    found = fuse(turned, outside)
    errors, rows = linearised(
        calibration,
        turned,
        outside,
        found,
        both,
    )
    size = rows.shape[2]
    assert size == len(calibration.vector) + (6 if both else 3)
    known_before = np.zeros((size, size))
    vectors = len(calibration.vector)
    known_before[:vectors, :vectors] = np.linalg.inv(calibration.covariance)
    change = np.zeros(size)
    change[:vectors] = found.calibration.vector - calibration.vector
    slopes = rows.reshape(-1, size)
    by_poses = slopes.T @ errors.ravel() / SIGMA**2
    gradient = by_poses + known_before @ change
    # One deviation of the result changes the cost by 1: the gradient is far below that.
    covariance = np.linalg.inv(known_before + slopes.T @ slopes / SIGMA**2)
    deviations = np.sqrt(np.diag(covariance))
    assert np.abs(gradient * deviations).max() < 0.02
    np.testing.assert_allclose(
        found.base_deviations,
        deviations[vectors : vectors + 3],
        rtol=0.02,
    )
    if both:
        np.testing.assert_allclose(
            found.handle_deviations,
            deviations[vectors + 3 :],
            rtol=0.02,
        )
    else:
        assert not found.handle_deviations.any()
        np.testing.assert_array_equal(found.handle, np.eye(3))
    np.testing.assert_allclose(
        found.calibration.covariance,
        covariance[:vectors, :vectors],
        atol=1e-3 * SIGMA**2,
    )
    assert found.rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.01, abs=1e-9)


@pytest.mark.parametrize('both', [True, False])
def test_the_errors_change_with_all_that_is_estimated_as_differences_say(calibration, both):
    model = calibration.model
    turned, outside = poses_and_readings(calibration, 4, 10.0 * SIGMA)
    handle = HANDLE if both else np.eye(3)
    now = outside_reference._Frames(
        calibration.vector,
        BASE,
        handle,
    )
    if not both:
        outside = outside @ HANDLE.T

    def errors_after(frames):
        rotation = model.orientations(turned, frames.vector)
        errors, rows = outside_reference._linearised(
            model,
            rotation,
            outside,
            frames,
            both,
        )
        # What is left is the error's length, each of its three parts counts.
        left = outside_reference._residual(
            rotation,
            outside,
            frames,
        )
        assert left == pytest.approx(np.sqrt(np.mean(errors**2)))
        return errors, rows

    before, rows = errors_after(now)
    count = len(calibration.vector)
    for column in (*range(0, count, 5), *range(count, rows.shape[2])):
        step = np.zeros(rows.shape[2])
        step[column] = 1e-5
        after, _ = errors_after(now.changed(step))
        np.testing.assert_allclose(
            (after - before) / 1e-5,
            rows[:, :, column],
            atol=0.02,
        )


@pytest.mark.parametrize(('noise', 'refused'), [(3.0, False), (6.0, True)])
def test_poses_that_are_off_by_more_than_four_deviations_contradict_the_motion(
    fuse,
    calibration,
    noise,
    refused,
):
    turned, outside = poses_and_readings(calibration, 30, noise * SIGMA)
    if not refused:
        assert 2.0 * SIGMA < fuse(turned, outside).rms < 4.0 * SIGMA
        return
    words = r'their residual is 0\.\d+ deg rms, expected up to 0\.200 deg$'
    with pytest.raises(CalibrationError, match=words):
        fuse(turned, outside)


def test_two_poses_contradict_the_motion_by_their_difference(fuse, calibration):
    """The base takes its mean: each of them is off by half of it, 6 deviations about an axis."""
    turned, outside = poses_and_readings(calibration, 2, 0.0)
    outside = outside @ HANDLE.T
    outside[1] = matrix_from_vector(np.array([[0.0, 30.0 * SIGMA, 0.0]]))[0] @ outside[1]
    with pytest.raises(CalibrationError, match='contradict the motion'):
        fuse(turned, outside)


def test_readings_without_an_orientation_are_refused():
    rotation = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    model = SimpleNamespace(orientations=lambda turned, vector: rotation)
    with pytest.raises(CalibrationError, match='^the readings at a pose from outside have no ori'):
        outside_reference._orientations(model, None, None)


def test_an_impossible_mechanism_contradicts_the_motion(calibration):
    def orientations(turned, vector):
        raise GeometryError('link angles: no such mechanism')

    with pytest.raises(
        CalibrationError, match='^the orientations from outside contradict the motion: link angles'
    ):
        outside_reference._orientations(
            SimpleNamespace(orientations=orientations),
            None,
            None,
        )


def test_the_base_follows_the_first_and_the_handle_the_last_three_numbers():
    frames = outside_reference._Frames(
        np.array([0.5, 0.25]),
        np.eye(3),
        np.eye(3),
    )
    change = np.array([0.25, -0.25, 0.1, 0.2, 0.3, -0.1, -0.2, 0.05])
    for numbers in (5, 8):
        after = frames.changed(change[:numbers])
        np.testing.assert_allclose(after.vector, [0.75, 0.0])
        np.testing.assert_allclose(rotation_vectors(after.base[None])[0], change[2:5])
        handle = change[5:] if numbers == 8 else np.zeros(3)
        np.testing.assert_allclose(
            rotation_vectors(after.handle[None])[0],
            handle,
            atol=1e-12,
        )


def test_a_fused_calibration_has_the_orientations_of_its_new_parameters():
    found = free_motions.short_calibration()
    rows = slice(None, None, 100)
    few = replace(
        found,
        rotation=found.rotation[rows],
        readings=replace(found.readings, readings=found.readings.readings[rows]),
    )
    vector = found.vector + 1e-3
    fused = outside_reference._fused(
        few,
        vector,
        2.0 * found.covariance,
    )
    np.testing.assert_array_equal(fused.vector, vector)
    np.testing.assert_array_equal(fused.covariance, 2.0 * found.covariance)
    expected = few.model.orientations(few.turned, vector)
    errors = rotation_vectors(fused.rotation @ expected.swapaxes(1, 2))
    assert np.abs(errors).max() < 1e-4
