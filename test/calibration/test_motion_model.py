# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The model of readings of a free motion: parameters, parity, and their derivatives."""

from free_motions import model_of, poses, random_vector, SIGMA, turned_a_little
import numpy as np
import pytest
from spm_haptic_master.calibration.motion.mechanism_parameters import GROUPS, Layout
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import estimate, Geometry, in_usual_frames
from spm_haptic_master.validation.alignment import rotation_vectors


def test_parameters_of_zero_are_the_drawing():
    layout = Layout(4)
    found = layout.geometry(np.zeros(layout.count))
    assert np.allclose(found.base_axes, Geometry().base_axes, atol=1e-15)
    assert np.allclose(found.platform_axes, Geometry().platform_axes, atol=1e-15)
    assert np.allclose([found.alphas, found.betas], [Geometry().alphas, Geometry().betas])


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_the_groups_fill_the_vector(sensors):
    layout = Layout(sensors)
    assert layout.count == sum(layout.sizes.values()) == len(layout.names) \
        == len(set(layout.names)) == len(layout.deviations)
    assert tuple(layout.sizes) == GROUPS
    assert np.isinf(layout.deviations[:sensors]).all()


@pytest.mark.parametrize('seed', range(5))
def test_every_vector_is_a_mechanism_in_its_usual_frames(seed):
    model = model_of()
    found = model.layout.geometry(random_vector(model, seed))
    usual, _, _ = in_usual_frames(found)
    assert np.allclose(usual.base_axes, found.base_axes, atol=1e-14)
    assert np.allclose(usual.platform_axes, found.platform_axes, atol=1e-14)


def test_a_mechanism_is_made_once_for_all_batches_of_samples():
    """A fit asks for it in each batch, and for those of the differences: half of its time."""
    model = model_of()
    layout, vector = model.layout, random_vector(model, 1)
    other_zeros = vector.copy()
    other_zeros[layout.slices['zeros']] += 1.0
    assert layout.geometry(other_zeros) is layout.geometry(vector)
    longer = vector.copy()
    longer[layout.slices['links'].start] += 1e-6
    assert layout.geometry(longer).alphas[0] == pytest.approx(
        layout.geometry(vector).alphas[0] + 1e-6, abs=1e-15)


def test_the_parameters_are_independent():
    """No combination of them leaves the mechanism as it is: twelve numbers, twelve directions."""
    model = model_of()
    layout = model.layout
    places = range(layout.slices['links'].start, layout.slices['platform axes'].stop)

    def numbers(vector):
        g = layout.geometry(vector)
        return np.concatenate([g.alphas, g.betas, np.ravel(g.base_axes),
                               np.ravel(g.platform_axes)])

    rows = []
    for place in places:
        vector = np.zeros(layout.count)
        vector[place] = 1e-6
        rows.append((numbers(vector) - numbers(np.zeros(layout.count))) / 1e-6)
    assert np.linalg.svd(rows)[1].min() > 0.5


def test_a_drawing_in_other_frames_is_refused():
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    g = Geometry()
    drawn = Geometry.from_axes(np.array(g.base_axes) @ turn.T, g.platform_axes, g.alphas, g.betas)
    with pytest.raises(InputError, match='geometry.base_axes: expected axes of the drawing'):
        Layout(4, drawn)


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_readings_give_their_orientations_back(sensors):
    model = model_of(sensors)
    vector, true = random_vector(model, 1), poses(50)
    found = model.orientations(model.readings(true, vector), vector)
    assert np.abs(rotation_vectors(found @ true.swapaxes(1, 2))).max() < 1e-9
    assert np.abs(model.linearised(model.readings(true, vector), found, vector, ()).parity
                  ).max() < 1e-6


def test_the_parity_is_that_of_the_estimate():
    """At the maximum-likelihood orientation, against `estimate`, which is another formula."""
    model = model_of()
    vector = np.zeros(model.layout.count)
    turned = model.readings(poses(40), vector) \
        + SIGMA * np.random.default_rng(2).normal(size=(40, 4))
    at = model.orientations(turned, vector)
    found = estimate(turned[:, :3], turned[:, 3], SIGMA)
    assert np.abs(rotation_vectors(at @ found.rotation.swapaxes(1, 2))).max() < 1e-7
    parity = model.linearised(turned, at, vector, ()).parity[:, 0]
    assert np.allclose(np.abs(parity), np.abs(found.parity), atol=1e-5)


@pytest.mark.parametrize('sensors', (4, 6))
def test_derivatives_of_the_parity_are_those_of_differences(sensors):
    """The size of the parity vector after each sample took its own best orientation."""
    model = model_of(sensors)
    vector = random_vector(model, 3)
    true = poses(12)
    turned = model.readings(true, vector) \
        + 3e-4 * np.random.default_rng(4).normal(size=(12, sensors))
    columns = tuple(range(model.layout.count))
    at = model.orientations(turned, vector)
    for _ in range(3):
        at = model.linearised(turned, at, vector).rotation
    here = model.linearised(turned, at, vector, columns)
    step = 2e-6
    for column in columns:
        sums = []
        for sign in (1.0, -1.0):
            moved = vector.copy()
            moved[column] += sign * step
            near = at
            for _ in range(3):
                near = model.linearised(turned, near, moved).rotation
            sums.append(np.sum(model.linearised(turned, near, moved, ()).parity ** 2, axis=1))
        expected = (sums[0] - sums[1]) / (2.0 * step)
        found = 2.0 * np.einsum('nk,nk->n', here.parity, here.derivative[:, :, column])
        # What the Gauss-Newton derivative leaves out is of the parity's own size.
        scale = np.linalg.norm(here.derivative[:, :, column], axis=1) * \
            np.linalg.norm(here.parity, axis=1)
        assert np.abs(found - expected).max() < 0.02 * scale.max() + 1e-6 * abs(expected).max()


def test_orientations_change_with_the_parameters_as_differences_say():
    model = model_of()
    vector, true = random_vector(model, 5), poses(8)
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
    vector, true = np.zeros(model.layout.count), poses(10)
    turned = model.readings(true, vector)
    rotation = turned_a_little(true, 6)
    rotation[3] = np.nan
    rotation[4] = np.diag([1.0, -1.0, -1.0])
    found = model.linearised(turned, rotation, vector, (0, 1))
    assert not found.usable[[3, 4]].any() and found.usable[[0, 1, 2, 5, 6, 7, 8, 9]].all()
    assert not found.parity[[3, 4]].any() and not found.derivative[[3, 4]].any()
