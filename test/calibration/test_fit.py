# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fit of parameters to a free motion, and what its covariance says."""

from dataclasses import replace

from free_motions import model_of, poses, random_vector, SIGMA
from linear_model import layout_of, LinearModel, no_rotation, samples_of
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import fit
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.model import GROUPS, Layout
from spm_haptic_master.exceptions import CalibrationError, GeometryError


def readings_of(
    model,
    vector,
    count,
    seed,
    noise=SIGMA,
):
    """Return readings with noise at poses of a motion."""
    exact = model.readings(poses(count, seed), vector)
    exact = exact[np.isfinite(exact).all(axis=1)]
    random = np.random.default_rng(seed)
    return exact + noise * random.normal(size=exact.shape)


@pytest.mark.parametrize('sensors', (4, 6))
def test_readings_without_noise_give_the_parameters_back(sensors):
    """From zeros so far away that four sensors need damped steps."""
    model = model_of(sensors)
    true = random_vector(model, 8)
    start = np.zeros(model.layout.count)
    off = np.array([0.2, 0.2, -0.2, 0.2, 0.2, 0.2])
    start[:sensors] = true[:sensors] + off[:sensors]
    nothing_known = replace(
        model, layout=replace(model.layout, mechanism_tolerance=np.inf, harmonic_tolerance=np.inf)
    )
    found = fit.fit(
        nothing_known,
        readings_of(model, true, 100, 8, noise=0.0),
        start,
        range(model.layout.count),
    )
    assert found.rms < 1e-4
    assert np.abs(found.vector - true).max() < 2e-4


@pytest.mark.slow
def test_one_sample_in_twenty_that_is_wrong_changes_little():
    model = model_of()
    random = np.random.default_rng(9)
    true = random_vector(model, 9)
    turned = readings_of(model, true, 1500, 9)
    wrong = random.uniform(size=len(turned)) < 0.05
    spoilt = turned.copy()
    count = wrong.sum()
    signs = random.choice((-1, 1), count)
    sizes = random.uniform(0.05, 3.0, count)
    spoilt[wrong, random.integers(0, 4, count)] += signs * sizes
    places = range(model.layout.slices['platform axes'].stop)
    start = np.where(np.arange(len(true)) < 4, true, 0.0)
    clean = fit.fit(model, turned, start, places)
    found = fit.fit(model, spoilt, start, places)
    known_before = np.diag(model.layout.deviations[places] ** -2.0)
    covariance = inverse(clean.normal.matrix + known_before)
    deviations = np.sqrt(np.diag(covariance))
    change = np.abs(found.vector - clean.vector)
    assert (change[places] < deviations).all()
    assert not found.normal.kept[wrong].mean() > 0.1


def test_what_is_not_estimated_enters_the_covariance():
    """Against many draws of the linear model itself."""
    random = np.random.default_rng(10)
    rows = random.normal(size=(60, 5))
    deviations = np.array([np.inf, 0.5, 0.3, 0.2, 0.4])
    columns = (0, 1, 3)
    information = rows.T @ rows
    predicted = fit.considered_covariance(information, deviations, columns)
    true = random.normal(size=(20000, 5)) * [0.0, *deviations[1:]]
    read = true @ rows.T + random.normal(size=(20000, 60))
    inside = list(columns)
    errors = -true
    estimated = rows[:, inside]
    known_before = np.diag(deviations[inside] ** -2.0)
    normal = estimated.T @ estimated + known_before
    errors[:, inside] += np.linalg.solve(normal, estimated.T @ read.T).T
    assert np.allclose(np.cov(errors.T), predicted, atol=0.03 * predicted.max())


def test_a_motion_without_an_orientation_is_refused():
    model = model_of()
    vector = np.zeros(model.layout.count)
    turned = np.full((50, 4), np.nan)
    rotation = np.full((50, 3, 3), np.nan)
    with pytest.raises(CalibrationError, match='no sample of the motion has an orientation'):
        fit.fit(
            model,
            turned,
            vector,
            (0, 1),
            rotation,
        )
    assert not fit.normal_equations(
        model,
        turned,
        rotation,
        vector,
        (0,),
    ).kept.any()


def test_a_third_of_the_motion_in_pieces_of_seconds_confirms_the_fit():
    held = fit.held_out_part(np.arange(0.0, 90.0, 0.1))
    assert held.mean() == pytest.approx(1.0 / 3.0, abs=0.03)
    # Four seconds for the fit, then two for the check.
    assert not held[:40].any()
    assert held[40:60].all()
    assert not held[60:100].any()
    with pytest.raises(CalibrationError, match='the motion lasts 1.9 s; expected more than'):
        fit.held_out_part(np.arange(0.0, 2.0, 0.1))


def linear_samples(
    count,
    parities=2,
    parameters=3,
    seed=1,
    noise=0.5,
):
    """Return a linear model, its samples, and their y and A."""
    random = np.random.default_rng(seed)
    deviations = [np.inf, *np.linspace(0.3, 0.6, parameters - 1)]
    rows = random.normal(size=(count, parities, parameters))
    y = rows @ np.linspace(0.4, -0.7, parameters) + noise * random.normal(size=(count, parities))
    return LinearModel(layout_of(deviations), parities), samples_of(y, rows), y, rows


@pytest.mark.parametrize('size_of_slice', [7, 10, 5000])
def test_normal_equations_are_sums_over_the_samples_within_the_limit(monkeypatch, size_of_slice):
    monkeypatch.setattr(fit, 'SLICE', size_of_slice)
    model, samples, y, rows = linear_samples(20)
    vector = np.array([0.1, -0.2, 0.3])
    parity = rows @ vector - y
    size = np.hypot(*parity.T)
    limit = float(np.sort(size)[-3])
    found = fit.normal_equations(
        model,
        samples,
        no_rotation(samples),
        vector,
        (0, 2),
        limit,
    )
    # The one at the limit is an outlier, too.
    np.testing.assert_array_equal(found.kept, size < limit)
    assert found.kept.sum() == 17
    inside = rows[size < limit][:, :, [0, 2]]
    np.testing.assert_allclose(found.matrix, np.einsum('nki,nkj->ij', inside, inside))
    np.testing.assert_allclose(found.right, np.einsum('nki,nk->i', inside, parity[size < limit]))
    assert found.cost == pytest.approx((np.minimum(size, limit) ** 2).sum())
    np.testing.assert_allclose(found.parity, parity)
    assert found.rotation.shape == (20, 3, 3)


@pytest.mark.parametrize(('deviation', 'expected'), [(3.0, 18.0), (1.0, 6.0), (0.1, 6.0)])
def test_an_outlier_is_beyond_six_deviations_of_the_rest(deviation, expected):
    """And of white noise at least: a parity is in its deviations."""
    random = np.random.default_rng(3)
    y = deviation * random.normal(size=(20001, 1))
    y[:50] = 1e3
    samples = samples_of(y, np.ones((len(y), 1, 1)))
    samples[100:110] = np.nan
    model = LinearModel(layout_of([np.inf]))
    found = fit.normal_equations(
        model,
        samples,
        no_rotation(samples),
        np.zeros(1),
        (0,),
    )
    assert found.limit == pytest.approx(expected, rel=0.02)
    assert not found.kept[:50].any()
    assert not found.kept[100:110].any()


def test_the_limit_of_outliers_follows_the_median_from_its_own_size_on():
    """Half of the samples are within 1, the other half within 1.5 of 0: at sizes of about 1."""
    y = np.linspace(0.0, 2.0, 101)[:, None]
    samples = samples_of(y, np.ones((101, 1, 1)))
    model = LinearModel(layout_of([np.inf]))
    found = fit.normal_equations(
        model,
        samples,
        no_rotation(samples),
        np.zeros(1),
        (),
    )
    # Of a normal distribution half is within 0.6745 deviations.
    assert found.limit == pytest.approx(6.0 / 0.6745, rel=1e-3)


def test_a_linear_fit_is_that_of_ridge_regression():
    """A parameter that is not estimated keeps its value."""
    model, samples, y, rows = linear_samples(50, parameters=4)
    start = np.array([0.2, 0.1, 0.4, -0.3])
    found = fit.fit(
        model,
        samples,
        start,
        (0, 1, 3),
    )
    inside = rows[:, :, [0, 1, 3]].reshape(-1, 3)
    rest = (y - 0.4 * rows[:, :, 2]).ravel()
    weights = model.layout.deviations[[0, 1, 3]] ** -2.0
    expected = np.linalg.solve(inside.T @ inside + np.diag(weights), inside.T @ rest)
    np.testing.assert_allclose(
        found.vector[[0, 1, 3]],
        expected,
        rtol=1e-9,
    )
    assert found.vector[2] == 0.4
    assert found.columns == (0, 1, 3)
    left = inside @ expected - rest
    assert found.misfit == pytest.approx(left @ left + weights @ expected**2)
    assert found.rms == pytest.approx(np.sqrt(np.mean(left**2)))
    # One step to the result, and one that shows that it is; once with another limit of outliers.
    assert model.count <= 6


def test_without_a_sample_that_is_kept_the_parity_is_infinite():
    model, samples, *_ = linear_samples(10)
    found = fit.fit(
        model,
        samples,
        np.zeros(3),
        (0,),
    )
    none = replace(found.normal, kept=np.zeros(10, dtype=bool))
    assert replace(found, normal=none).rms == np.inf


def test_a_damped_step_is_that_of_levenberg_and_marquardt():
    """What nothing determines yet stays as it is."""
    model, samples, *_ = linear_samples(30)
    now = fit.normal_equations(
        model,
        samples,
        no_rotation(samples),
        np.zeros(3),
        (0, 1, 2),
    )
    weights = np.array([0.0, 11.0, 3.0])
    estimated = np.array([0.3, -0.2, 0.1])
    matrix = now.matrix + np.diag(weights)
    right = now.right + weights * estimated
    for damping in (0.0, 0.7):
        damped = matrix + damping * np.diag(np.diag(matrix))
        step = fit._damped_step(
            now,
            weights,
            estimated,
            damping,
        )
        np.testing.assert_allclose(step, -np.linalg.solve(damped, right))
    unseen = replace(
        now,
        matrix=np.diag([2.0, 0.0, 0.0]),
        right=np.array([1.0, 0.0, 0.0]),
    )
    step = fit._damped_step(
        unseen,
        np.zeros(3),
        estimated,
        0.0,
    )
    np.testing.assert_allclose(
        step,
        [-0.5, 0.0, 0.0],
        atol=1e-12,
    )


class Steep(LinearModel):
    """A model that reports slopes that are twice too steep: each step goes half of the way."""

    def parity(
        self,
        y,
        rows,
        vector,
    ):
        parity, slopes = super().parity(y, rows, vector)
        return parity, 2.0 * slopes


@pytest.mark.parametrize('parameters', [1, 2])
@pytest.mark.parametrize('far', [1.0, 1.3, 1.7, 1.9])
def test_a_fit_ends_with_a_step_of_a_fiftieth_of_the_deviation(parameters, far):
    """After it as much is left as it was long, of each parameter."""
    rows = np.tile(np.eye(parameters)[:, None], (5, 1, 1))
    samples = samples_of(np.zeros((len(rows), 1)), rows)
    model = Steep(layout_of([np.inf] * parameters))
    deviation = 1.0 / (2.0 * np.sqrt(5.0))
    start = np.full(parameters, far * deviation)
    found = fit.fit(
        model,
        samples,
        start,
        range(parameters),
    )
    left = np.abs(found.vector) / deviation
    assert (left < 0.02).all()
    assert (left >= 0.01).all()


class Arctangent(LinearModel):
    """A parity of arctan(A x - y), of which undamped steps from beyond 1.39 run away."""

    limit = np.inf

    def parity(
        self,
        y,
        rows,
        vector,
    ):
        if np.abs(vector).max() > self.limit:
            raise GeometryError('no such mechanism')
        straight = rows @ vector - y
        return np.arctan(straight), rows / (1.0 + straight**2)[:, :, None]


def test_a_step_that_never_helps_is_damped_up_to_ten_thousand(monkeypatch):
    """First without damping, then from 1e-8 on by tens; and the parameters stay."""
    tried = []

    def damped_step(now, weights, estimated, damping):
        tried.append(damping)
        return np.array([0.1])

    monkeypatch.setattr(fit, '_damped_step', damped_step)
    monkeypatch.setattr(fit, '_normal_after', lambda *_: None)
    samples = samples_of(np.zeros((4, 1)), np.full((4, 1, 1), 1.0))
    found = fit.fit(Arctangent(layout_of([np.inf])), samples, np.array([1.5]), (0,))
    assert tried == pytest.approx([0.0, *(10.0**power for power in range(-8, 5))])
    assert found.vector == [1.5]


@pytest.mark.parametrize('limit', [np.inf, 40.0])
@pytest.mark.parametrize('start', [1.5, -3.0, 12.0, 30.0])
def test_damping_brings_back_steps_that_run_away_or_to_no_mechanism(start, limit):
    model = Arctangent(layout_of([np.inf]))
    model.limit = limit
    samples = samples_of(np.zeros((4, 1)), np.full((4, 1, 1), 1.0))
    found = fit.fit(
        model,
        samples,
        np.array([start]),
        (0,),
    )
    assert abs(found.vector[0]) < 1e-3


@pytest.mark.parametrize(('factor', 'follows'), [(1.019, 0), (0.981, 0), (1.022, 1), (0.979, 1)])
def test_the_limit_of_outliers_is_followed_if_it_changes_by_a_fiftieth(factor, follows):
    model, samples, y, rows = linear_samples(40, noise=30.0)
    vector = np.zeros(3)
    own = fit.normal_equations(
        model,
        samples,
        no_rotation(samples),
        vector,
        (0,),
    )
    assert own.limit > 6.0
    before = fit.normal_equations(
        model,
        samples,
        own.rotation,
        vector,
        (0,),
        factor * own.limit,
    )
    after = fit._with_own_limit(
        model,
        samples,
        before,
        vector,
        (0,),
    )
    assert after.limit == (own.limit if follows else before.limit)


def selection_of(fitted, held):
    """Return the selection of a linear model with samples of the part fitted and held out."""
    rows = np.concatenate([fitted[1], held[1]])
    y = np.concatenate([fitted[0], held[0]])
    model = LinearModel(layout_of([np.inf, *[0.5] * (rows.shape[2] - 1)]))
    samples = samples_of(y, rows)
    is_held = np.arange(len(y)) >= len(fitted[0])
    first = fit.fit(
        model,
        samples,
        np.zeros(rows.shape[2]),
        (0,),
    )
    return fit._Selection(
        model,
        samples,
        is_held,
        first,
    )


@pytest.mark.parametrize('factor', [1.0, 3.0])
def test_parameters_are_determined_if_the_motion_narrows_their_tolerance_by_a_twentieth(factor):
    """
    Two of three samples are fitted; the whole motion has `factor` times all of them.

    One deviation of 0.5 before, and information J: 1 / sqrt(4 + J) after.
    """
    narrows = [0.93, 0.945, 0.955, 0.97]
    of_motion = 4.0 * (np.power(narrows, -2.0) - 1.0)
    slopes = np.sqrt(of_motion / (40.0 * factor * 1.5))
    rows = np.tile(np.diag([1.0, *slopes])[:, None], (40, 1, 1))
    nothing = np.zeros((len(rows), 1))
    half = len(rows) // 2
    found = selection_of((nothing, rows), (nothing[:half], rows[:half]))
    assert found.determined([1, 2, 3, 4], factor) == [1, 2]
    assert found.determined([4, 2], factor) == [2]


@pytest.mark.parametrize(('deviations', 'confirmed'), [(2.9, True), (3.1, False), (-5.0, True)])
def test_what_is_held_out_may_be_worse_by_three_standard_errors(deviations, confirmed):
    """Less than by one parameter for ten samples of the fit: noise alone makes it so much."""
    count = 16
    spread = 0.4 * np.where(np.arange(count) % 2, 1.0, -1.0)
    worse = 0.1 + deviations * 0.4 / np.sqrt(count)
    # Without the second parameter the held-out parity is 1; with it, which is 1, another one.
    after = np.sqrt(1.0 + worse + spread)
    held_rows = np.stack([0.0 * after, after - 1.0], axis=1)[:, None]
    rows = np.array([[1.0, 0.0], [0.0, 1e4]] * 5)[:, None]
    found = selection_of((rows[:, :, 1], rows), (np.full((count, 1), -1.0), held_rows))
    assert found.confirms([1]) is confirmed
    assert found.columns == ([0, 1] if confirmed else [0])
    assert found.fit.columns == ((0, 1) if confirmed else (0,))
    assert found.fit.vector[1] == pytest.approx(1.0 if confirmed else 0.0, abs=1e-6)
    if confirmed:
        # Again it is compared with what has just been kept.
        assert found.confirms([]) is True


def test_held_out_outliers_count_with_their_limit():
    y = np.array([[1.0], [-2.0], [0.5], [1.5], [50.0], [-1.0], [np.nan]])
    model = LinearModel(layout_of([np.inf]))
    squares = fit._outside(
        model,
        samples_of(y, np.ones((7, 1, 1))),
        np.zeros(1),
    )
    limit = 6.0 * 1.4826 * 1.25
    np.testing.assert_allclose(squares[:6], [1.0, 4.0, 0.25, 2.25, limit**2, 1.0])


def chosen(
    wrong_of_held=(),
    unseen=(),
    only_together=False,
):
    """
    Choose among the groups of a linear model with 0.1 for each parameter.

    The part held out has other parameters of the groups `wrong_of_held`, and no sample sees those
    of `unseen`. Of two groups that are confirmed together only, the part fitted sees mostly the
    sum of two parameters, and the part held out their difference.
    """
    layout = Layout(
        4,
        mechanism_tolerance=1.0,
        harmonic_tolerance=1.0,
    )
    model = LinearModel(layout)
    random = np.random.default_rng(2)
    count = 1200
    seconds = 0.05 * np.arange(count)
    held = fit.held_out_part(seconds)
    rows = 200.0 * random.normal(size=(count, 1, layout.count))
    for group in unseen:
        rows[:, :, layout.columns(group)] = 0.0
    if only_together:
        link = layout.columns('links')[0]
        axis = layout.columns('base axes')[0]
        alike = np.where(held, -1.0, random.uniform(0.8, 1.2, count))
        rows[:, :, axis] = alike[:, None] * rows[:, :, link]
    true = np.tile(np.full(layout.count, 0.1), (count, 1))
    for group in wrong_of_held:
        true[np.ix_(held, layout.columns(group))] = -0.1
    y = np.einsum('nkp,np->nk', rows, true) + random.normal(size=(count, 1))
    samples = samples_of(y, rows)
    first = fit.fit(
        model,
        samples,
        np.zeros(layout.count),
        layout.columns('zeros'),
    )
    seen = []
    vector, columns, left = fit.choose(
        model,
        samples,
        seconds,
        first,
        1.0,
        lambda group, number: seen.append((group, number)),
    )
    assert seen == [(group, number) for number, group in enumerate(GROUPS) if number]
    return layout, vector, columns, left


def test_groups_that_the_motion_determines_and_confirms_are_chosen():
    layout, vector, columns, left = chosen()
    assert columns == tuple(range(layout.count))
    assert left == {}
    np.testing.assert_allclose(
        vector,
        0.1,
        atol=2e-3,
    )


def test_a_group_that_nothing_determines_is_left_with_that_reason():
    layout, vector, columns, left = chosen(unseen=('base axes',))
    assert left == {'base axes': 'the motion does not determine them'}
    assert set(columns) == set(range(layout.count)) - set(layout.columns('base axes'))
    assert not vector[layout.columns('base axes')].any()


def test_a_group_that_the_part_held_out_contradicts_is_left_with_that_reason():
    layout, vector, columns, left = chosen(wrong_of_held=('platform axes',))
    assert left == {'platform axes': 'they do not explain the held-out motion better'}
    assert set(columns) == set(range(layout.count)) - set(layout.columns('platform axes'))
    assert not vector[layout.columns('platform axes')].any()


def test_groups_that_are_confirmed_together_only_are_chosen():
    layout, vector, columns, left = chosen(only_together=True)
    assert columns == tuple(range(layout.count))
    assert left == {}
    np.testing.assert_allclose(
        vector,
        0.1,
        atol=2e-3,
    )
