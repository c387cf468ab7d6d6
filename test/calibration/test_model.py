# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The model of readings of a free motion: parameters, parity, and their derivatives."""

from dataclasses import replace
from math import radians

from free_motions import model_of, poses, random_vector, SIGMA, turned_a_little
import numpy as np
import pytest
from spm_haptic_master.calibration.motion.model import _continuous, Layout
from spm_haptic_master.calibration.watch.slip_evidence import reached
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import estimate, Geometry, in_usual_frames, workspace_pose
from spm_haptic_master.kinematics.rotations import matrix_from_vector
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


def test_parameters_have_names_and_an_ordinary_workshops_tolerances():
    """Half a degree, and 0.3 deg of the encoders' first harmonics, a tenth of it of the second."""
    layout = Layout(4)
    numbered = [f'platform axes, deviation {number}' for number in (1, 2, 3)]
    assert list(layout.names[layout.slices['platform axes']]) == numbered
    assert layout.names[:4] == tuple(
        f'zero of joint_{joint}' for joint in ('1a', '1b', '1c', '3a')
    )
    assert layout.names[4:10:5] == ('proximal link A', 'distal link C')
    assert layout.names[-1] == 'second harmonic of joint_3a, sine'
    degrees = np.degrees(layout.deviations)
    np.testing.assert_allclose(degrees[4:16], 0.5)
    np.testing.assert_allclose(degrees[16:24], 0.3)
    np.testing.assert_allclose(degrees[24:], 0.03)


@pytest.mark.parametrize('without', [None, 'first harmonics', 'second harmonics'])
def test_harmonics_are_cosine_and_sine_of_the_angle_and_of_twice_it(without):
    layout = Layout(5)
    random = np.random.default_rng(1)
    vector = random.normal(size=layout.count)
    if without:
        vector[layout.slices[without]] = 0.0
    first = vector[layout.slices['first harmonics']].reshape(5, 2)
    second = vector[layout.slices['second harmonics']].reshape(5, 2)
    angles = random.uniform(-3.0, 3.0, (7, 5))

    def expected(angles):
        once = first[:, 0] * np.cos(angles) + first[:, 1] * np.sin(angles)
        return once + second[:, 0] * np.cos(2.0 * angles) + second[:, 1] * np.sin(2.0 * angles)

    deviation, slope = layout.harmonic_deviation(angles, vector)
    np.testing.assert_allclose(deviation, expected(angles))
    difference = (expected(angles + 1e-6) - expected(angles - 1e-6)) / 2e-6
    np.testing.assert_allclose(
        slope,
        difference,
        atol=1e-8,
    )
    # Of the cosines or the sines alone, as well.
    for part in (0, 1):
        alone = np.zeros(layout.count)
        alone[layout.columns('first harmonics')[part::2]] = 0.5
        trigonometric = (np.cos, np.sin)[part](angles)
        np.testing.assert_allclose(
            layout.harmonic_deviation(angles, alone)[0], 0.5 * trigonometric
        )


def test_without_harmonics_readings_deviate_by_nothing():
    layout = Layout(4)
    for angles in (np.ones((3, 4)), np.ones((3, 1))):
        deviation, slope = layout.harmonic_deviation(angles, np.zeros(layout.count))
        np.testing.assert_array_equal(deviation, np.zeros((3, 4)))
        np.testing.assert_array_equal(slope, np.zeros((3, 4)))


def skewed():
    """Return a drawing in which no two axes of the base are at a right angle."""
    base = np.array([[0.0, 0.0, 1.0], [np.sin(1.4), 0.0, np.cos(1.4)], [0.2, 0.95, 0.15]])
    base[2] /= np.linalg.norm(base[2])
    drawn = Geometry()
    return Geometry.from_axes(
        base,
        drawn.platform_axes,
        drawn.alphas,
        drawn.betas,
    )


def changed(layout, **numbers):
    """Return the mechanism with parameters of the group `base_axes`, `links`, ..., rad."""
    vector = np.zeros(layout.count)
    for group, values in numbers.items():
        vector[layout.slices[group.replace('_', ' ')]] = values
    return layout.geometry(vector)


def test_links_deviate_by_their_numbers():
    layout = Layout(4, skewed())
    found = changed(layout, links=[0.01, 0.02, 0.03, 0.04, 0.05, 0.06])
    np.testing.assert_allclose(
        np.subtract(found.alphas, layout.nominal.alphas), [0.01, 0.02, 0.03]
    )
    np.testing.assert_allclose(np.subtract(found.betas, layout.nominal.betas), [0.04, 0.05, 0.06])
    np.testing.assert_allclose(
        found.base_axes,
        layout.nominal.base_axes,
        atol=1e-12,
    )
    np.testing.assert_allclose(
        found.platform_axes,
        layout.nominal.platform_axes,
        atol=1e-12,
    )


@pytest.mark.parametrize('turn', [0.03, -0.02])
def test_the_second_axis_of_the_base_is_turned_away_from_the_first(turn):
    layout = Layout(4, skewed())
    found = np.array(changed(layout, base_axes=[turn, 0.0, 0.0]).base_axes)
    np.testing.assert_allclose(found[1], [np.sin(1.4 + turn), 0.0, np.cos(1.4 + turn)])
    np.testing.assert_allclose(found[[0, 2]], np.array(layout.nominal.base_axes)[[0, 2]])


@pytest.mark.parametrize(('towards', 'across'), [(0.03, 0.0), (0.0, -0.02), (-0.04, 0.05)])
def test_the_third_axis_of_the_base_is_turned_towards_the_first_and_across(towards, across):
    """Its two directions and itself are at right angles; it remains a unit vector."""
    layout = Layout(4, skewed())
    first, second, third = np.array(layout.nominal.base_axes)
    sideways = np.cross(third, first) / np.linalg.norm(np.cross(third, first))
    to = np.cross(sideways, third)
    assert to @ first > 0.0
    found = np.array(changed(layout, base_axes=[0.0, towards, across]).base_axes)
    expected = third + towards * to + across * sideways
    np.testing.assert_allclose(found[2], expected / np.linalg.norm(expected))
    np.testing.assert_allclose(
        found[:2],
        [first, second],
        atol=1e-12,
    )


@pytest.mark.parametrize('number', [0, 1, 2])
def test_a_deviation_of_the_platform_axes_is_no_rotation_and_no_change_of_length(number):
    """Of first order: their angles change, and no rotation undoes it."""
    layout = Layout(4)
    step = 1e-6
    numbers = step * np.eye(3)[number]
    found = np.array(changed(layout, platform_axes=numbers).platform_axes)
    drawn = np.array(layout.nominal.platform_axes)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    cosines = (found @ found.T - drawn @ drawn.T)[[0, 1, 2], [1, 2, 0]] / step
    assert np.linalg.norm(cosines) > 0.5
    tangent = layout.platform_tangents[number]
    np.testing.assert_allclose(
        (tangent * drawn).sum(axis=1),
        0.0,
        atol=1e-12,
    )
    torque = np.cross(drawn, tangent).sum(axis=0)
    np.testing.assert_allclose(
        torque,
        0.0,
        atol=1e-12,
    )
    # The frame of the platform follows its axes: their angles are those of the deviation.
    moved = drawn + step * tangent
    expected = (moved @ moved.T)[[0, 1, 2], [1, 2, 0]]
    np.testing.assert_allclose(
        (found @ found.T)[[0, 1, 2], [1, 2, 0]],
        expected,
        atol=1e-11,
    )


@pytest.mark.parametrize('sensors', (4, 6))
def test_corrected_readings_are_the_joint_angles(sensors):
    model = model_of(sensors)
    vector = random_vector(model, 6)
    rotation = poses(20)
    turned = model.readings(rotation, vector)
    angles = model.joint_angles(rotation, model.layout.geometry(vector))
    errors = np.angle(np.exp(1j * (model.corrected(turned, vector) - angles)))
    # Two steps leave the third power of a harmonic of 0.3 deg.
    assert np.abs(errors).max() < 3e-6
    assert np.abs(np.angle(np.exp(1j * (turned - vector[:sensors] - angles)))).max() > 1e-3


@pytest.mark.parametrize('sensors', (4, 6))
def test_a_step_of_an_orientation_is_that_of_least_squares(sensors):
    """From 1 deg away, of exact readings, it leaves less than a twentieth of that."""
    model = model_of(sensors)
    vector = random_vector(model, 6)
    true = poses(20)
    turned = model.readings(true, vector)
    found = model.linearised(
        turned,
        turned_a_little(true, 3, 0.01),
        vector,
    )
    assert found.usable.all()
    left = rotation_vectors(found.rotation @ true.swapaxes(1, 2))
    assert np.abs(left).max() < 1e-3


@pytest.mark.parametrize(('far', 'usable'), [(0.27, True), (0.33, False)])
def test_an_orientation_that_is_farther_off_than_a_step_of_0_3_is_none(far, usable):
    model = model_of()
    vector = np.zeros(model.layout.count)
    true = poses(6)
    rates = np.array([[0.0, 0.0, far], [0.0, -far, 0.0]] * 3)
    # The step about an axis: readings that are off by the Jacobian's share of it.
    *_, jacobian = reached(
        true,
        model.layout.nominal,
        (1, 1, 1),
        4,
    )
    turned = model.readings(true, vector) + np.einsum('nij,nj->ni', jacobian, rates)
    found = model.linearised(
        turned,
        true,
        vector,
        (0,),
    )
    assert (found.usable == usable).all()
    expected = matrix_from_vector(rates) @ true if usable else true
    np.testing.assert_allclose(
        found.rotation,
        expected,
        atol=1e-6,
    )
    assert found.derivative.any() == usable


@pytest.mark.parametrize('sensors', (4, 6))
def test_derivatives_of_the_readings_are_those_of_differences(sensors):
    """By each parameter, with the harmonics of a bad encoder: the slope counts, too."""
    model = model_of(sensors)
    vector = random_vector(model, 7)
    vector[model.layout.slices['first harmonics']] = 0.1
    rotation = poses(5)
    angles = model.joint_angles(rotation, model.layout.geometry(vector))
    slope = model.layout.harmonic_deviation(angles, vector)[1]
    columns = tuple(range(model.layout.count))
    found = model._derivative(
        rotation,
        angles,
        slope,
        vector,
        columns,
    )
    for column in columns:
        step = 1e-5 * np.eye(len(columns))[column]
        above = model.readings(rotation, vector + step)
        below = model.readings(rotation, vector - step)
        expected = np.angle(np.exp(1j * (below - above))) / 2e-5
        np.testing.assert_allclose(
            found[:, :, column],
            expected,
            atol=1e-4,
        )


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_orientation_changes_are_weighted_least_squares(sensors):
    """A sensor with half of the noise counts four times."""
    model = model_of(sensors)
    model = replace(model, sigma=SIGMA * np.linspace(0.5, 2.0, sensors))
    vector = random_vector(model, 7)
    vector[model.layout.slices['first harmonics']] = 0.1
    rotation = poses(3)
    found = model.orientation_changes(rotation, vector)
    geometry = model.layout.geometry(vector)
    angles = model.joint_angles(rotation, geometry)
    slope = model.layout.harmonic_deviation(angles, vector)[1]
    every = tuple(range(model.layout.count))
    by = model._derivative(
        rotation,
        angles,
        slope,
        vector,
        every,
    )
    *_, rates = reached(
        rotation,
        geometry,
        (1, 1, 1),
        sensors,
    )
    for sample in range(3):
        of_readings = rates[sample] * (1.0 + slope[sample])[:, None]
        weights = np.diag(model.sigma**-2.0)
        normal = of_readings.T @ weights @ of_readings
        expected = np.linalg.solve(normal, of_readings.T @ weights @ by[sample])
        np.testing.assert_allclose(
            found[sample],
            expected,
            atol=1e-9,
        )


def test_a_drawing_may_be_off_its_usual_frames_by_rounding():
    base = np.array(Geometry().base_axes)
    for off, refused in ((0.5e-9, False), (1e-7, True), (radians(0.1), True)):
        turn = matrix_from_vector(np.array([[0.0, 0.0, off]]))[0]
        drawn = Geometry()
        turned = Geometry.from_axes(
            base @ turn.T,
            drawn.platform_axes,
            drawn.alphas,
            drawn.betas,
        )
        if refused:
            with pytest.raises(
                InputError, match='in the usual frames, Z1A = z and Z1B in the half'
            ):
                Layout(4, turned)
        else:
            Layout(4, turned)


@pytest.mark.parametrize('sensors', (4, 5, 6))
def test_the_parity_has_a_basis_by_the_minors_of_the_jacobian(sensors):
    """Of any Jacobians, and whatever basis it had: the sign of no vector is left to chance."""
    random = np.random.default_rng(sensors)
    rates = random.normal(size=(40, sensors, 3))
    across = np.array([np.linalg.svd(each)[0][:, 3:].T for each in rates])
    mixed, _ = np.linalg.qr(random.normal(size=(40, sensors - 3, sensors - 3)))
    mixed *= random.choice((-1.0, 1.0), (40, 1, 1))
    gain = mixed @ across
    found = _continuous(gain, rates)
    np.testing.assert_allclose(
        found.swapaxes(1, 2) @ found,
        gain.swapaxes(1, 2) @ gain,
        atol=1e-12,
    )
    # Of the first four rows, each without one of them.
    rows = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]
    minors = np.array([np.linalg.det(rates[:, each]) for each in rows]).T * [1.0, -1.0, 1.0, -1.0]
    first = found[:, 0, :4]
    expected = minors / np.linalg.norm(minors, axis=1, keepdims=True)
    lengths = np.linalg.norm(first, axis=1, keepdims=True)
    np.testing.assert_allclose(
        first,
        lengths * expected,
        atol=1e-9,
    )
    # A further sensor has a vector of its own, in which it is positive and those after it 0.
    for place in range(4, sensors):
        assert (found[:, place - 3, place] > 0.0).all()
        np.testing.assert_allclose(
            found[:, : place - 3, place],
            0.0,
            atol=1e-12,
        )
