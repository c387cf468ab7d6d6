# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The model of readings of a free motion: parameters, parity, and their derivatives."""

from free_motions import model_of, poses, random_vector, SIGMA, turned_a_little
import numpy as np
import pytest
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import estimate, Geometry, in_usual_frames, workspace_pose
from spm_haptic_master.validation.alignment import rotation_vectors


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_the_groups_fill_the_vector_and_zero_is_the_drawing(sensors):
    layout = Layout(sensors, mechanism_tolerance=2.0, harmonic_tolerance=3.0)
    assert layout.count == len(set(layout.names)) == 12 + 5 * sensors
    # Each parameter by its name: zeros, links, axes, harmonics of first and second order.
    expected = [
        np.inf
        if name.startswith('zero')
        else 3.0
        if name.startswith('first')
        else 0.3
        if name.startswith('second')
        else 2.0
        for name in layout.names
    ]
    np.testing.assert_allclose(layout.deviations, expected)
    assert layout.names[layout.columns('first harmonics')[3]] == 'first harmonic of joint_1b, sine'
    found = layout.geometry(np.zeros(layout.count))
    drawn = Geometry()
    for name in ('base_axes', 'platform_axes', 'alphas', 'betas'):
        assert np.allclose(getattr(found, name), getattr(drawn, name), atol=1e-15)


def test_the_parameters_are_independent_in_the_usual_frames():
    """No combination of them leaves the mechanism as it is: twelve numbers, twelve directions."""
    layout = Layout(4)

    def numbers(geometry):
        return np.concatenate(
            [
                np.ravel(each)
                for each in (
                    geometry.alphas,
                    geometry.betas,
                    geometry.base_axes,
                    geometry.platform_axes,
                )
            ]
        )

    found = layout.geometry(random_vector(model_of(), 1))
    assert np.allclose(numbers(in_usual_frames(found)), numbers(found), atol=1e-14)
    drawn = numbers(Geometry())
    step = 1e-6 * np.eye(layout.count)
    rows = [
        numbers(layout.geometry(step[place])) - drawn
        for place in range(layout.slices['links'].start, layout.slices['platform axes'].stop)
    ]
    assert np.linalg.svd(rows)[1].min() > 0.5e-6


def test_a_drawing_in_other_frames_is_refused():
    turn = np.array(
        [
            [0.0, -1.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    g = Geometry()
    drawn = Geometry.from_axes(
        np.array(g.base_axes) @ turn.T,
        g.platform_axes,
        g.alphas,
        g.betas,
    )
    with pytest.raises(InputError, match='geometry.base_axes: expected axes of the drawing'):
        Layout(4, drawn)


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_the_parity_is_that_of_the_estimate(sensors):
    """At the maximum-likelihood orientation, against `estimate`, which is another formula."""
    model = model_of(sensors)
    vector = np.zeros(model.layout.count)
    turned = model.readings(poses(40), vector) + SIGMA * np.random.default_rng(2).normal(
        size=(40, sensors)
    )
    at = model.orientations(turned, vector)
    more = dict(zip(('theta3b', 'theta3c'), turned.T[4:], strict=False))
    found = estimate(
        turned[:, :3],
        turned[:, 3],
        SIGMA,
        **more,
    )
    assert np.abs(rotation_vectors(at @ found.rotation.swapaxes(1, 2))).max() < 1e-7
    parity = model.linearised(turned, at, vector, ()).parity
    sizes = np.linalg.norm(parity, axis=1)
    assert np.allclose(sizes, np.abs(found.parity), atol=1e-5)


@pytest.mark.parametrize('sensors', (4, 6))
def test_derivatives_of_the_parity_are_those_of_differences(sensors):
    """The size of the parity vector after each sample took its own best orientation."""
    model = model_of(sensors)
    vector = random_vector(model, 3)
    true = poses(5)
    noise = 3e-4 * np.random.default_rng(4).normal(size=(5, sensors))
    turned = model.readings(true, vector) + noise
    columns = tuple(range(model.layout.count))

    def settled(vector, columns=()):
        return model.linearised(
            turned,
            model.orientations(turned, vector),
            vector,
            columns,
        )

    here = settled(vector, columns)
    for column in columns[::2]:
        step = 2e-6 * np.eye(len(columns))[column]
        above = np.sum(settled(vector + step).parity ** 2, axis=1)
        below = np.sum(settled(vector - step).parity ** 2, axis=1)
        expected = (above - below) / 4e-6
        derivative = here.derivative[:, :, column]
        found = 2.0 * (here.parity * derivative).sum(axis=1)
        # What the Gauss-Newton derivative leaves out is of the parity's own size.
        left_out = np.linalg.norm(derivative, axis=1) * np.linalg.norm(here.parity, axis=1)
        tolerance = 0.02 * left_out.max() + 1e-6 * np.abs(expected).max()
        assert np.abs(found - expected).max() < tolerance


def test_orientations_change_with_the_parameters_as_differences_say():
    model = model_of()
    vector = random_vector(model, 5)
    true = poses(8)
    turned = model.readings(true, vector)
    changes = model.orientation_changes(true, vector)
    for column in range(model.layout.count):
        moved = vector.copy()
        moved[column] += 1e-5
        after = model.orientations(turned, moved)
        found = rotation_vectors(after @ true.swapaxes(1, 2)) / 1e-5
        assert np.abs(found - changes[:, :, column]).max() < 1e-3


def test_samples_out_of_reach_are_left_out():
    model = model_of()
    vector = np.zeros(model.layout.count)
    true = poses(10)
    turned = model.readings(true, vector)
    rotation = turned_a_little(true, 6)
    rotation[3] = np.nan
    rotation[4] = np.diag([1.0, -1.0, -1.0])
    found = model.linearised(
        turned,
        rotation,
        vector,
        (0, 1),
    )
    assert not found.usable[[3, 4]].any()
    assert found.usable[[0, 1, 2, 5, 6, 7, 8, 9]].all()
    assert not found.parity[[3, 4]].any()
    assert not found.derivative[[3, 4]].any()


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_the_parity_of_a_constant_error_has_no_jump_and_begins_with_that_of_four(sensors):
    """The third reading is off, on a circle across the singularity."""
    model = model_of(sensors)
    four = model_of()
    azimuth = np.linspace(0.0, 2.0 * np.pi, 2000)
    rotation = workspace_pose(0.25, azimuth, 0.8 + 0.5 * np.sin(azimuth))
    turned = model.readings(rotation, np.zeros(model.layout.count))
    turned[:, 2] += 3e-4
    found, of_four = (
        each.linearised(
            turned[:, : each.layout.sensors],
            rotation,
            np.zeros(each.layout.count),
            (0, 1, 2),
        )
        for each in (model, four)
    )
    assert found.usable.all()
    for parity in found.parity.T:
        assert np.ptp(parity) > 0.1
        largest_step = np.abs(np.diff(parity)).max()
        assert largest_step < 0.02 * np.abs(parity).max()
    np.testing.assert_allclose(found.parity[:, 0], of_four.parity[:, 0], atol=1e-9)
    np.testing.assert_allclose(found.derivative[:, 0], of_four.derivative[:, 0], atol=1e-5)
