# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rigs that are not the model's: slips, drift, play, axes that miss the centre, by their names."""

from dataclasses import replace
from math import radians, tau
import re

import free_motions
from free_motions import calibrated, short_motion
from linear_model import layout_of, LinearModel, no_rotation, samples_of
from non_concentric import closed_angles
import numpy as np
import pytest
from simulated_hand import Condition, hand_motion
from spm_haptic_master.calibration.motion import misfit
from spm_haptic_master.calibration.motion.calibration import CONTRADICTION
from spm_haptic_master.calibration.motion.fit import Fit, fit, Normal, normal_equations
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    matrix_from_zxz,
    workspace_pose,
    zxz_from_matrix,
)
from spm_haptic_master.simulation.rig import perfect_rig


def changed(sensor, change, **how):
    """Return the calibration with a sensor's angles changed, deg, by a function of 0 .. 1."""
    stamps, raw, direction, zeros = short_motion()
    raw = raw[::10].copy()
    part = np.arange(len(raw)) / len(raw)
    raw[:, sensor] += direction[sensor] * np.radians(change(part))
    return calibrated(
        stamps[::10],
        raw,
        direction,
        zeros,
        **how,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    'sensor, part',
    [
        (1, 0.06),
        *(
            pytest.param(*case, marks=pytest.mark.evidence)
            for case in ((0, 0.03), (3, 0.94), (2, 0.97))
        ),
    ],
)
def test_a_slip_near_an_end_of_the_motion_names_no_wrong_sensor(sensor, part):
    name = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')[sensor]
    try:
        found = changed(sensor, lambda at: 1.0 * (at >= part))
    except CalibrationError as error:
        assert re.match(rf'{name} slipped by \+|one of the encoders slipped during', str(error))
    else:
        # So short a part is cut, and that is said.
        assert found.cut > 0.5 * min(part, 1.0 - part)
        assert any('were cut: an encoder that slipped' in each for each in found.cautions)


def test_play_is_a_caution_and_raises_the_bias():
    healthy = free_motions.short_calibration()
    shares = []
    _, raw, direction, _ = short_motion()
    turns = np.unwrap(raw[::10, 0] * direction[0])
    smooth = np.convolve(turns, np.ones(25) / 25.0, 'same')
    sense = np.sign(np.gradient(smooth))
    found = changed(
        0,
        lambda at: 0.1 * sense,
        progress=lambda text, share: shares.append(share),
    )
    assert any(
        'contradict each other' in caution and 'play' in caution for caution in found.cautions
    )
    assert found.bias[0] > radians(0.1)
    assert (found.bias > healthy.bias).all()
    assert shares == [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.9, 0.95]


@pytest.mark.slow
def test_axes_that_miss_the_centre_are_a_caution():
    geometry = Geometry()
    condition = Condition('motion', seconds=32.0)
    rotation = hand_motion(perfect_rig(geometry, 0.0), condition, 41)[::8]
    random = np.random.default_rng(1)
    offsets = 3.0 * random.normal(size=(3, 3, 3)) * [1.0, 1.0, 0.0]
    drawn = inverse(rotation[:50], geometry)
    assert np.allclose(
        closed_angles(rotation[:50], 0.0 * offsets, geometry),
        np.column_stack([drawn.theta1, drawn.theta3a]),
        atol=1e-9,
    )
    angles = closed_angles(rotation, offsets, geometry)
    zeros = random.uniform(0.0, tau, 4)
    direction = np.array([1, -1, 1, 1])
    read = angles + random.normal(size=angles.shape) * radians(0.02) + zeros
    stamps = (np.arange(len(rotation)) * 8e6).astype(np.int64)
    found = calibrated(stamps, direction * read, direction, zeros)
    assert any('axes that miss the centre' in caution for caution in found.cautions)


def test_a_motion_through_few_parts_of_the_workspace_does_not_contradict_itself():
    """Tilt and self-rotation grow together: most of the eight parts have no sample."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 5)
    along = np.linspace(-1.0, 1.0, 400)
    rotation = workspace_pose(0.2 * along, 0.8, 0.7 + 0.3 * along)
    turned = with_noise(model.readings(rotation, vector), 2)
    found = fit(
        model,
        turned,
        vector,
        range(model.layout.sensors),
        rotation,
    )
    assert misfit.contradiction(model, turned, found) < CONTRADICTION


SECONDS = 0.01 * np.arange(3000)
FASTEN = 'fasten the encoder and move the device again'


@pytest.mark.parametrize(
    ('sensor', 'change_deg', 'words'),
    [
        (
            0,
            0.5 * (SECONDS > 12.0),
            'joint_1a slipped by +0.50 deg during the motion, about 12 s after its beginning; '
            + FASTEN,
        ),
        # A slip of any encoder explains that of this one as well.
        (
            1,
            -0.4 * (SECONDS > 20.0),
            'one of the encoders slipped during the motion, about 20 s after its beginning; '
            + FASTEN,
        ),
        (
            2,
            0.02 * SECONDS,
            'joint_1c drifted by +0.60 deg during the motion; let it warm up, check its coupling '
            'and move the device again',
        ),
    ],
)
def test_a_slip_during_a_motion_is_named(
    sensor,
    change_deg,
    words,
):
    with pytest.raises(CalibrationError, match=f'^{re.escape(words)}$'):
        check_slip(sensor, change_deg)


def test_a_motion_without_a_slip_has_white_parity():
    assert check_slip(0, 0.0 * SECONDS) == pytest.approx(1.0)


def check_slip(sensor, change_deg):
    """Check a motion in which a zero changes, deg; return how slow its parity is."""
    model = free_motions.model_of()
    vector = free_motions.random_vector(model, 5)
    turned = with_noise(model.readings(free_motions.poses(3000), vector), 1)
    turned[:, sensor] += np.radians(change_deg)
    found = fit(model, turned, vector, range(4))
    slow = misfit.slow_factor(SECONDS, found.normal)
    assert slow > 200.0 or not change_deg.any()
    misfit.check_slip(model, turned, SECONDS, found)
    return slow


def with_noise(turned, seed):
    """Return readings with the noise of the model."""
    random = np.random.default_rng(seed)
    return turned + free_motions.SIGMA * random.normal(size=turned.shape)


def normal_of(parity, kept=None):
    """Return normal equations of which the parities alone count, shape (n, K)."""
    parity = np.asarray(parity, dtype=float)
    return Normal(
        cost=0.0,
        matrix=np.zeros((0, 0)),
        right=np.zeros(0),
        parity=parity,
        kept=np.ones(len(parity), dtype=bool) if kept is None else kept,
        rotation=no_rotation(parity),
        limit=6.0,
    )


def test_slow_errors_are_the_means_of_half_seconds():
    """The mean of m samples of white noise has the variance 1 / m; these have more."""
    seconds = np.concatenate([np.arange(0.0, 1.0, 0.05), 3.0 + np.arange(0.0, 0.5, 0.05)])
    changing = np.where(np.arange(30) % 2, 5.0, -5.0)
    of_pieces = np.repeat(
        [[3.0, 0.0], [0.0, 4.0], [1.0, 2.0]],
        10,
        axis=0,
    )
    parity = of_pieces + changing[:, None]
    expected = 10.0 * (9.0 + 16.0 + 5.0) / 6.0
    assert misfit.slow_factor(seconds, normal_of(parity)) == pytest.approx(expected)
    # Of samples that do not count, and of white noise alone, nothing is seen.
    kept = np.arange(30) < 20
    expected = 10.0 * (9.0 + 16.0) / 4.0
    assert misfit.slow_factor(seconds, normal_of(parity, kept)) == pytest.approx(expected)
    assert misfit.slow_factor(seconds, normal_of(changing[:, None])) == 1.0


def pieces_of(sizes, samples=16):
    """Return times and parities of pieces of half a second with constant parities, (1, 1)."""
    seconds = 0.5 * np.arange(len(sizes))[:, None] + np.linspace(0.01, 0.49, samples)
    parity = np.repeat(sizes, samples)[:, None] * [0.6, -0.8]
    return seconds.ravel(), parity


def test_the_slow_parity_is_what_ninety_nine_of_a_hundred_pieces_do_not_exceed():
    """Less the size that the means of white noise have: 2.576 deviations in as many."""
    sizes = np.linspace(0.0, 2.0, 201)
    seconds, parity = pieces_of(sizes)
    expected = np.sqrt(1.98**2 - 2.576**2 / 16.0)
    assert misfit.slow_parity(seconds, normal_of(parity)) == pytest.approx(expected, rel=1e-3)
    assert misfit.slow_parity(seconds, normal_of(0.3 * parity)) == 0.0


@pytest.mark.parametrize(('samples', 'counts'), [(7, False), (8, False), (9, True)])
def test_a_piece_with_half_of_its_samples_or_less_is_no_piece(samples, counts):
    seconds, parity = pieces_of(np.ones(40))
    parity[:16] *= 10.0
    without = np.arange(len(seconds)) >= 16
    kept = without | (np.arange(len(seconds)) < samples)
    found = misfit.slow_parity(seconds, normal_of(parity, kept))
    assert (found > 2.0) is counts


@pytest.mark.parametrize(('count', 'step'), [(300, 1), (1000, 2)])
def test_the_error_that_no_parameter_explains_is_that_of_one_sensor_alone(count, step):
    """A slow parity s of a sensor that changes it by g for each rad is an error of s / g, rms."""
    random = np.random.default_rng(3)
    rows = random.normal(size=(count + 1, 2, 5))
    samples = samples_of(random.normal(size=(count + 1, 2)), rows)
    model = LinearModel(layout_of([np.inf] * 4 + [1.0]), 2)
    normal = replace(normal_of(np.zeros((count + 1, 2))), kept=np.arange(count + 1) > 0)
    found = misfit.unexplained_errors(
        model,
        samples,
        np.zeros(5),
        normal,
        3.0,
    )
    gains = rows[1::step, :, :4]
    lengths = np.sqrt((gains**2).sum(axis=1).mean(axis=0))
    np.testing.assert_allclose(found, 3.0 / lengths)


def contradicting(axis, count=301):
    """
    Return a linear model, samples of a motion, and a fit of it.

    The parameters change with the tilt in x (axis 0), in y (1), or the self-rotation (2).
    """
    random = np.random.default_rng(4)
    psi, theta, phi = random.uniform([-3.0, 0.1, 2.0], [3.0, 0.6, 4.5], (count, 3)).T
    rotation = matrix_from_zxz(psi, theta, phi)
    rows = random.normal(size=(count, 1, 4))
    places = halves_by(rotation)[axis]
    changes = np.array([0.5, -0.1, 0.3, 0.2]) * np.where(places, 1.0, -1.0)[:, None]
    y = np.einsum('nkp,np->nk', rows, 1.0 + changes) + 0.3 * random.normal(size=(count, 1))
    # A few without an orientation, and an outlier.
    rotation[:3] = np.nan
    y[10] = 90.0
    model = LinearModel(layout_of([np.inf, 0.7, 0.9, 0.8]))
    samples = samples_of(y, rows)
    return (
        model,
        samples,
        fit(
            model,
            samples,
            np.zeros(4),
            (0, 1, 3),
            rotation,
        ),
    )


def halves_by(rotation):
    """Return which orientations are in the upper half, by tilt in x, in y, and self-rotation."""
    phi = np.full(len(rotation), np.nan)
    known = np.isfinite(rotation[:, 0, 0])
    phi[known] = zxz_from_matrix(rotation[known])[2]
    mean = np.angle(np.nansum(np.exp(1j * phi)))
    around = np.angle(np.exp(1j * (phi - mean)))
    places = (rotation[:, 0, 2], rotation[:, 1, 2], around)
    return [place > np.nanmedian(place) for place in places]


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_halves_contradict_each_other_by_their_difference_over_its_covariance(axis):
    """Each half is fitted alone, with half of what is known before."""
    model, samples, found = contradicting(axis)
    kept = found.normal.kept
    y, rows = model.parts(samples)
    y = y[:, 0] - 0.0 * rows[:, 0, 2]
    inside = rows[:, 0, [0, 1, 3]]
    known_before = np.diag(0.5 * model.layout.deviations[[0, 1, 3]] ** -2.0)
    figures = []
    for upper in halves_by(found.normal.rotation):
        estimates = []
        covariances = []
        for half in (kept & upper, kept & ~upper):
            covariance = np.linalg.inv(inside[half].T @ inside[half] + known_before)
            estimates.append(covariance @ inside[half].T @ y[half])
            covariances.append(covariance)
        difference = estimates[1] - estimates[0]
        total = covariances[0] + covariances[1]
        figures.append(difference @ np.linalg.inv(total) @ difference / 3.0)
    assert np.argmax(figures) == axis
    assert misfit.contradiction(model, samples, found) == pytest.approx(max(figures), rel=1e-4)


def test_what_a_slip_explains_is_what_one_more_parameter_would_improve():
    """A step of one zero after each piece, and a drift: each is fitted here by itself."""
    random = np.random.default_rng(5)
    count = 240
    rows = random.normal(size=(count, 1, 5))
    y = rows @ np.array([0.2, -0.1, 0.3, 0.1, 0.4]) + random.normal(size=(count, 1))
    y[:, 0] += 0.8 * rows[:, 0, 1] * (np.arange(count) >= 100)
    # Spikes of 290 and of 310 deviations: the second one does not count.
    y[50] += 290.0
    y[150] -= 310.0
    model = LinearModel(layout_of([np.inf] * 4 + [0.5]))
    samples = samples_of(y, rows)
    vector = np.array([0.2, -0.1, 0.3, 0.1, 0.3])
    normal = normal_equations(
        model,
        samples,
        no_rotation(samples),
        vector,
        tuple(range(5)),
    )
    found = misfit._slips(
        model,
        samples,
        Fit(
            vector,
            tuple(range(5)),
            normal,
            0.0,
        ),
    )
    counted = np.arange(count) != 150
    known_before = np.array([0.0, 0.0, 0.0, 0.0, 2.0])
    right = np.append(y[counted, 0], 0.0)

    def cost(*more):
        """Return the cost with further columns, and the last of the parameters."""
        matrix = np.column_stack([rows[counted, 0], *(column[counted] for column in more)])
        prior = np.append(known_before, np.zeros(len(more)))
        matrix = np.vstack([matrix, prior])
        estimated = np.linalg.lstsq(matrix, right, rcond=None)[0]
        return np.sum((matrix @ estimated - right) ** 2), estimated[-1]

    before, _ = cost()
    piece = np.arange(count) // 4
    for number in (0, 10, 24, 30, 58, 59):
        part = (piece + 0.5) / 60.0 if number == 59 else np.where(piece > number, 1.0, 0.0)
        for sensor in range(4):
            after, size = cost(part * rows[:, 0, sensor])
            assert found.explained[number, sensor] == pytest.approx(before - after, rel=1e-6)
            slip = -found.slope[number, sensor] / found.size[number, sensor]
            assert slip == pytest.approx(size, rel=1e-6)
    # 290 deviations are much more than noise: three tenths of their square.
    assert found.least == pytest.approx(0.3 * (before - 239), rel=0.05)


def test_a_slip_that_nothing_shows_explains_nothing():
    slips = misfit._Slips(
        slope=np.array([[3.0, 2.0, 0.5]]),
        size=np.array([[4.0, 0.0, -1e-9]]),
        least=100.0,
    )
    np.testing.assert_array_equal(slips.explained, [[2.25, 0.0, 0.0]])


def said_of(
    monkeypatch,
    row,
    best,
    other,
    least=100.0,
):
    """Return what is said where the third of four sensors explains `best`, the first `other`."""
    size = np.ones((60, 4))
    slope = np.zeros((60, 4))
    slope[row, 2] = np.sqrt(best)
    slope[5, 0] = np.sqrt(other)
    slips = misfit._Slips(
        slope=0.01 * slope,
        size=1e-4 * size,
        least=least,
    )
    monkeypatch.setattr(
        misfit,
        '_slips',
        lambda *_: slips,
    )
    try:
        misfit.check_slip(
            None,
            None,
            10.0 + 0.1 * np.arange(600),
            None,
        )
    except CalibrationError as error:
        return str(error)
    return ''


def test_no_slip_is_named_that_noise_may_feign(monkeypatch):
    assert (
        said_of(
            monkeypatch,
            20,
            best=99.9,
            other=0.0,
        )
        == ''
    )
    assert (
        said_of(
            monkeypatch,
            20,
            best=399.0,
            other=0.0,
            least=400.0,
        )
        == ''
    )
    assert said_of(
        monkeypatch,
        20,
        best=101.0,
        other=0.0,
    ).startswith('joint_1c slipped by')


def test_a_slip_is_named_with_size_and_time(monkeypatch):
    """Of 60 pieces of a second from 10 s on; the slip is after the 21st."""
    assert said_of(
        monkeypatch,
        20,
        best=400.0,
        other=0.0,
    ) == (
        f'joint_1c slipped by {np.degrees(-2000.0):+.2f} deg during the motion, about 31 s after '
        f'its beginning; {FASTEN}'
    )
    assert said_of(
        monkeypatch,
        59,
        best=400.0,
        other=0.0,
    ).startswith('joint_1c drifted by')
    assert ' about 69 s after' in said_of(
        monkeypatch,
        58,
        best=400.0,
        other=0.0,
    )


@pytest.mark.parametrize(
    ('other', 'named'), [(0.0, True), (890.0, True), (910.0, False), (999.0, False)]
)
def test_a_sensor_is_named_if_no_other_explains_nine_tenths_as_much(
    monkeypatch,
    other,
    named,
):
    said = said_of(
        monkeypatch,
        20,
        best=1000.0,
        other=other,
    )
    assert said.startswith(
        'joint_1c slipped by' if named else 'one of the encoders slipped during'
    )
    # Nor one that explains no more than noise may.
    assert said_of(
        monkeypatch,
        20,
        best=105.0,
        other=99.0,
    ).startswith('joint_1c slipped by')
