# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The search for zeros and directions of which nothing is known."""

from math import log, radians, tau
from types import SimpleNamespace

from free_motions import model_of, poses
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import zero_search
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings
from spm_haptic_master.calibration.motion.zero_search import (
    ComparedGuess,
    find_start,
    search_zeros,
    Start,
    ZeroGuess,
)
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, workspace_pose
from spm_haptic_master.kinematics.rotations import wrapped


def samples(
    direction,
    zeros,
    seed,
    links=0.0,
):
    """Return the raw readings of 80 poses, rad, of links that are off by normal deviations."""
    model = model_of()
    vector = np.zeros(model.layout.count)
    random = np.random.default_rng(seed)
    vector[model.layout.slices['links']] = links * random.normal(size=6)
    turned = model.readings(poses(80, seed), vector) + zeros
    turned += radians(0.04) * random.normal(size=turned.shape)
    read = turned * direction
    from_median = (turned - np.median(turned, axis=0)) ** 2
    middle = np.argmin(from_median.sum(axis=1))
    return np.roll(read, -middle, axis=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    'seed', [0, *(pytest.param(seed, marks=pytest.mark.evidence) for seed in (1, 2, 3))]
)
def test_the_best_are_the_true_ones_and_stand_alone(seed):
    random = np.random.default_rng(seed)
    direction = random.choice((-1, 1), 4)
    zeros = random.uniform(-np.pi, np.pi, 4)
    read = samples(
        direction,
        zeros,
        seed,
        links=radians(0.3),
    )
    layout = model_of().layout
    found = search_zeros(read, layout, 24)
    again = search_zeros(read, layout, 24)
    best = found[0]
    assert all(
        np.array_equal(one.zeros, other.zeros) for one, other in zip(found, again, strict=True)
    )
    assert [each.misfit for each in found] == sorted(each.misfit for each in found)
    assert best.direction == tuple(direction)
    # Links off by 0.3 deg are explained by zeros off by a degree.
    errors = wrapped(best.zeros - zeros)
    assert np.degrees(np.abs(errors)).max() < 3.0
    assert found[1].misfit > 3.0 * best.misfit


def test_two_guesses_that_come_to_the_same_zeros_are_one(monkeypatch):
    """One that the search has left 4 deg off, as by the noise of 12 bits, is no second answer."""
    read = samples((1, 1, -1, 1), np.array([0.5, -0.2, 1.0, 2.0]), 3)
    model = model_of()
    true = np.array([0.5, -0.2, 1.0, 2.0])
    guesses = [
        zero_search.ZeroGuess(
            direction=(1, 1, -1, 1),
            zeros=zeros,
            misfit=radians(misfit),
        )
        for zeros, misfit in ((true, 0.1), (true + np.radians([4.0, -1.0, -2.0, 1.0]), 1.4))
    ]
    monkeypatch.setattr(zero_search, 'search_zeros', lambda *_: guesses)
    found = zero_search._explaining(read, model, 1)
    assert found is not None
    assert found.direction == (1, 1, -1, 1)
    errors = wrapped(found.vector[:4] - true)
    assert np.degrees(np.abs(errors)).max() < 4.1


def test_a_wrong_pair_that_several_zeros_explain_does_not_end_the_search(monkeypatch):
    """The last two of six are swapped; other swaps leave several choices."""

    def explaining(
        readings,
        model,
        count,
    ):
        first = readings[0].tolist()
        if first == [0.0, 1.0, 2.0, 3.0, 5.0, 4.0]:
            return Start((1,) * 6, np.zeros(model.layout.count))
        if first == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]:
            return None
        raise CalibrationError('the motion does not determine the zeros: many explain it')

    monkeypatch.setattr('spm_haptic_master.calibration.motion.zero_search._explaining', explaining)
    readings = np.tile(np.arange(6.0), (10, 1))
    means = MotionReadings(
        seconds=np.arange(10.0),
        readings=readings,
        noise=np.ones(6),
        together=1,
        spiked=np.zeros(10, dtype=bool),
    )
    with pytest.raises(CalibrationError, match='^joint_3b and joint_3c are swapped: '):
        find_start(means, model_of(6))


def test_further_sensors_have_the_zeros_and_directions_that_those_of_four_leave():
    model = model_of(6)
    random = np.random.default_rng(7)
    zeros = random.uniform(-np.pi, np.pi, 6)
    direction = (1, -1, 1, 1, -1, 1)
    perfect = model.readings(poses(60), np.zeros(model.layout.count))
    readings = (perfect + zeros) * direction
    # Of a pose without an orientation nothing follows.
    readings[5, :4] += 1.0
    found = zero_search._with_more(
        readings,
        model,
        zero_search.ZeroGuess(
            direction=direction[:4],
            zeros=zeros[:4],
            misfit=0.0,
        ),
    )
    assert found.direction == direction
    assert np.abs(wrapped(found.vector[:6] - zeros)).max() < 1e-6
    assert not found.vector[6:].any()


ONWARDS = (1, 1, 1, 1)


@pytest.mark.parametrize(('degrees', 'near', 'other'), [(0.9, 1, 0), (1.1, 0, 0), (2.1, 0, 1)])
@pytest.mark.parametrize('turns', [0, 1, -2])
def test_guesses_are_the_same_within_a_degree_and_others_beyond_two(
    degrees,
    near,
    other,
    turns,
):
    zeros = np.array([0.3, -2.0, 1.5, 3.0])
    moved = zeros + tau * turns
    moved[2] -= radians(degrees)
    guesses = [ZeroGuess(ONWARDS, each, 0.0) for each in (zeros, moved)]
    assert guesses[0].is_near(guesses[1]) is bool(near)
    reversed_guess = ZeroGuess((1, -1, 1, 1), zeros, 0.0)
    assert not guesses[0].is_near(reversed_guess)
    fits = [ComparedGuess(0.0, Start(ONWARDS, zeros), each) for each in (zeros, moved)]
    assert fits[0].is_other_than(fits[1]) is bool(other)
    assert fits[0].is_other_than(
        ComparedGuess(
            0.0,
            Start((1, -1, 1, 1), zeros),
            zeros,
        )
    )


def some_readings(count=30, seed=4):
    """Return exact angles at poses, and a model whose parity is in rad."""
    model = MotionModel(model_of().layout, np.ones(4))
    random = np.random.default_rng(seed)
    tilt, azimuth, turn = random.uniform([0.0, 0.0, 0.2], [0.25, tau, 1.4], (count, 3)).T
    rotation = workspace_pose(tilt, azimuth, turn)
    return model.readings(rotation, np.zeros(model.layout.count)), model


def test_the_distance_of_angles_that_fit_together_is_their_parity():
    """To first order it is how far the angles are from the nearest ones that fit."""
    exact, model = some_readings()
    off = 1e-4 * np.random.default_rng(5).normal(size=exact.shape)
    nothing = np.zeros(model.layout.count)
    at = model.orientations(exact + off, nothing)
    parity = model.linearised(exact + off, at, nothing).parity[:, 0]
    zeros = np.array([[0.0, 0.0, 0.0, 0.0], [0.4, -1.0, 2.0, 0.1]])
    for each in zeros:
        distance, _ = zero_search._distance(
            exact + off + each,
            each[None],
            Geometry(),
        )
        np.testing.assert_allclose(
            np.abs(distance[0]),
            np.abs(parity),
            atol=2e-7,
        )
    far, _ = zero_search._distance(
        exact,
        zeros[1:],
        Geometry(),
    )
    assert np.median(np.abs(far)) > 0.1


def test_slopes_of_the_distance_are_those_of_differences():
    exact, _ = some_readings()
    zeros = np.array([[1e-4, 0.0, -1e-4, 0.0], [0.0, 2e-4, 0.0, 1e-4]])
    _, slopes = zero_search._distance(exact, zeros, Geometry())
    assert slopes.shape == (2, 30, 4)
    for sensor in range(4):
        step = 1e-5 * np.eye(4)[sensor]
        above, _ = zero_search._distance(
            exact,
            zeros + step,
            Geometry(),
        )
        below, _ = zero_search._distance(
            exact,
            zeros - step,
            Geometry(),
        )
        np.testing.assert_allclose(
            slopes[:, :, sensor],
            (above - below) / 2e-5,
            atol=2e-3,
        )
    # Each row is that of a distance: of unit length.
    np.testing.assert_allclose(
        np.linalg.norm(slopes, axis=2),
        1.0,
        atol=1e-6,
    )


def test_outliers_hardly_count_in_the_cost():
    """The loss of a sample at 0.05 rad is log 2: it counts half."""
    distance = np.array([[0.05, 0.0], [0.5, 0.05], [-0.05, -0.05]])
    expected = [0.5 * log(2.0), 0.5 * (log(101.0) + log(2.0)), log(2.0)]
    np.testing.assert_allclose(zero_search._cost(distance), expected)


def test_a_step_of_the_search_is_levenberg_and_marquardts_with_the_robust_weights():
    """Each of several guesses by itself; a step that is no better is not made."""
    exact, _ = some_readings()
    random = np.random.default_rng(6)
    zeros = random.normal(size=(5, 4)) * np.array([[0.01], [0.05], [0.3], [0.5], [2.0]])
    damping = np.array([0.01, 0.1, 0.01, 1.0, 1e-4])
    moved, cost, further = zero_search._improve(
        exact,
        zeros,
        damping,
        Geometry(),
        1,
    )
    is_better = []
    for guess, start in enumerate(zeros):
        distance, slopes = (
            part[0]
            for part in zero_search._distance(
                exact,
                start[None],
                Geometry(),
            )
        )
        weights = 1.0 / (1.0 + (distance / 0.05) ** 2)
        matrix = slopes.T @ np.diag(weights) @ slopes
        matrix += damping[guess] * np.mean(np.diag(matrix)) * np.eye(4)
        step = -np.linalg.solve(matrix, slopes.T @ (weights * distance))
        before = zero_search._cost(distance[None])[0]
        there, _ = zero_search._distance(
            exact,
            (start + step)[None],
            Geometry(),
        )
        after = zero_search._cost(there)[0]
        is_better.append(bool(after < before))
        np.testing.assert_allclose(moved[guess], start + step if is_better[-1] else start)
        assert cost[guess] == pytest.approx(min(before, after))
        # Bold after a better step, careful after a worse one.
        assert (further[guess] < damping[guess]) == is_better[-1]
    assert 0 < sum(is_better) < 5


def test_further_steps_of_the_search_never_raise_the_cost():
    exact, _ = some_readings()
    zeros = 0.1 * np.random.default_rng(7).normal(size=(6, 4))
    costs = [
        zero_search._improve(
            exact,
            zeros,
            np.full(6, 0.01),
            Geometry(),
            steps,
        )[1]
        for steps in (0, 1, 3, 10, 30)
    ]
    for before, after in zip(costs, costs[1:], strict=False):
        assert (after <= before).all()
    assert costs[-1].min() < 1e-6


def test_the_search_tells_the_directions_from_orientations_near_the_first(monkeypatch):
    """Of the orientations tried, one is out of reach, and two are some degrees off."""
    direction = np.array([1, -1, -1, 1])
    zeros = np.array([0.5, -2.2, 1.0, 3.0])
    exact, model = some_readings(40)
    tried = []

    def near(rotation, **_):
        tried.append(rotation)
        off = np.radians([[np.nan] * 4, [3.0, -2.0, 4.0, -3.0], [-2.0, 3.0, 3.0, 2.0]])
        others = np.full((len(rotation) - 3, 4), np.nan)
        return np.concatenate([exact[0] + off, others])

    monkeypatch.setattr(
        zero_search,
        'sensor_angles',
        near,
    )
    found = search_zeros(
        (exact + zeros) * direction,
        model.layout,
        2,
    )
    best = found[0]
    assert best.direction == tuple(direction)
    assert np.abs(wrapped(best.zeros - zeros)).max() < 1e-4
    assert best.misfit < 1e-5
    misfits = [guess.misfit for guess in found]
    assert misfits == sorted(misfits)
    assert misfits[1] > radians(0.5)
    assert {guess.direction for guess in found} >= {tuple(-direction), tuple(direction)}
    # All are rotations, and spread over all of them.
    (rotation,) = tried
    np.testing.assert_allclose(np.linalg.norm(rotation, axis=2), 1.0)
    assert np.abs(rotation.mean(axis=0)).max() < 0.3


def guesses_of(monkeypatch, *misfits_deg):
    """Return the guesses that are worth a fit, of a search with these misfits."""
    guesses = [
        ZeroGuess(
            ONWARDS,
            np.full(4, number),
            radians(misfit),
        )
        for number, misfit in enumerate(misfits_deg)
    ]
    monkeypatch.setattr(
        zero_search,
        'search_zeros',
        lambda *_: guesses,
    )
    exact, model = some_readings()
    return [int(guess.zeros[0]) for guess in zero_search._guesses(exact, model.layout, 1)]


def test_at_most_four_guesses_within_a_degree_and_a_half_are_compared(monkeypatch):
    assert guesses_of(
        monkeypatch,
        0.1,
        0.2,
        0.29,
        0.29,
        0.31,
        0.31,
    ) == [0, 1, 2, 3]
    assert guesses_of(
        monkeypatch,
        0.1,
        1.4,
        1.6,
        1.7,
    ) == [0, 1]
    assert guesses_of(monkeypatch, 1.6) == []


@pytest.mark.parametrize('misfits', [(0.1, *[0.29] * 4), (0.6, *[1.4] * 4)])
def test_more_guesses_that_are_nearly_as_good_leave_the_zeros_open(monkeypatch, misfits):
    with pytest.raises(CalibrationError, match='does not determine the zeros: many explain it'):
        guesses_of(monkeypatch, *misfits)


def explained(monkeypatch, *fits, samples=30):
    """Return what explains a motion whose guesses have these fits; None is one that fits not."""
    exact, model = some_readings(samples)
    monkeypatch.setattr(
        zero_search,
        '_guesses',
        lambda *_: range(len(fits)),
    )
    monkeypatch.setattr(
        zero_search,
        '_compared',
        lambda readings, model, guess: fits[guess],
    )
    return zero_search._explaining(exact, model, 1)


def fit_with(misfit, first_zero):
    """Return a guess after its fit."""
    zeros = np.array([first_zero, 0.0, 0.0, 0.0])
    return ComparedGuess(
        misfit,
        Start(ONWARDS, zeros + 0.01),
        zeros,
    )


def test_the_best_fit_explains_a_motion_if_others_are_worse_or_the_same(monkeypatch):
    best = fit_with(20.0, 0.5)
    assert explained(monkeypatch) is None
    assert explained(monkeypatch, None, None) is None
    assert explained(monkeypatch, None, best) is best.start
    assert explained(monkeypatch, fit_with(121.0, 1.0), best) is best.start
    assert (
        explained(
            monkeypatch,
            best,
            fit_with(30.0, 0.5 + radians(1.9)),
        )
        is best.start
    )
    # Where the best misfit is ten times that of noise, so is the margin.
    poor = fit_with(300.0, 0.5)
    assert (
        explained(
            monkeypatch,
            poor,
            fit_with(1301.0, 1.0),
        )
        is poor.start
    )


@pytest.mark.parametrize(('best', 'other'), [(20.0, 119.0), (300.0, 1299.0)])
def test_other_zeros_that_explain_a_motion_nearly_as_well_are_an_error(
    monkeypatch,
    best,
    other,
):
    fits = [fit_with(other, 1.0), None, fit_with(other + 1e4, -1.0), fit_with(best, 0.5)]
    with pytest.raises(CalibrationError, match=r'28\.6 and 57\.3 deg of joint_1a explain it'):
        explained(monkeypatch, *fits)


@pytest.mark.parametrize(
    ('parity_deg', 'kept', 'fits'),
    [(0.24, 1.0, True), (0.26, 1.0, False), (0.1, 0.5, True), (0.1, 0.49, False)],
)
def test_a_guess_with_more_parity_or_outliers_than_a_mechanism_leaves_is_none(
    monkeypatch,
    parity_deg,
    kept,
    fits,
):
    """A quarter of a degree, and half of the samples."""
    exact, _ = some_readings()
    model = MotionModel(model_of().layout, np.array([1.0, 2.0, 3.0, 4.0]) * 1e-4)
    result = SimpleNamespace(
        rms=radians(parity_deg) / 2.5e-4,
        normal=SimpleNamespace(kept=np.arange(100) < 100 * kept),
        misfit=7.0,
        vector=np.arange(32.0),
    )
    given = []

    def fit(
        model,
        turned,
        vector,
        columns,
    ):
        given.append((turned, vector, columns))
        return result

    monkeypatch.setattr(zero_search, 'fit', fit)
    direction = (1, -1, 1, -1)
    guess = ZeroGuess(
        direction,
        np.array([0.1, 0.2, 0.3, 0.4]),
        0.01,
    )
    found = zero_search._compared(
        exact * direction,
        model,
        guess,
    )
    assert (found is not None) is fits
    ((turned, vector, columns),) = given
    np.testing.assert_array_equal(turned, exact)
    np.testing.assert_array_equal(vector[:5], [0.1, 0.2, 0.3, 0.4, 0.0])
    assert tuple(columns) == tuple(range(32))
    if fits:
        assert found.misfit == 7.0
        np.testing.assert_array_equal(found.zeros, [0.0, 1.0, 2.0, 3.0])


def test_a_guess_that_no_fit_follows_is_none(monkeypatch):
    def fit(*_):
        raise CalibrationError('no sample of the motion has an orientation')

    monkeypatch.setattr(zero_search, 'fit', fit)
    exact, model = some_readings()
    assert (
        zero_search._compared(
            exact,
            model,
            ZeroGuess(ONWARDS, np.zeros(4), 0.01),
        )
        is None
    )


def searches(
    monkeypatch,
    swaps,
    explains=lambda order, count: None,
):
    """Return order of the sensors, number of guesses, and shares done of the searches."""
    seen = []
    shares = []

    def explaining(
        readings,
        model,
        count,
    ):
        seen.append((readings[0].astype(int).tolist(), count))
        return explains(*seen[-1])

    monkeypatch.setattr(
        zero_search,
        '_explaining',
        explaining,
    )
    means = SimpleNamespace(readings=np.tile(np.arange(4.0), (10, 1)))
    try:
        find_start(
            means,
            model_of(),
            lambda text, share: shares.append(share),
            swaps,
        )
    except CalibrationError as error:
        assert str(error).startswith('no zeros and directions of the encoders explain the motion')
        assert 'in the order joint_1a, joint_1b, joint_1c, joint_3a,' in str(error)
    assert (means.readings == np.arange(4.0)).all()
    return seen, shares


def test_swapped_encoders_are_looked_for_before_a_longer_search(monkeypatch):
    seen, shares = searches(monkeypatch, True)
    orders = [''.join(map(str, order)) for order, _ in seen]
    assert orders == ['0123', '1023', '2103', '3120', '0213', '0321', '0132', '0123']
    counts = [count for _, count in seen]
    assert len(set(counts[:-1])) == 1
    assert counts[-1] > 2 * counts[0]
    # The search is the first half of a calibration.
    np.testing.assert_allclose(shares, 0.5 * np.arange(8) / 8.0)
    seen, shares = searches(monkeypatch, False)
    assert [order for order, _ in seen] == [[0, 1, 2, 3]] * 2
    assert shares == [0.0, 0.25]


def test_a_search_ends_with_the_first_zeros_that_explain_the_motion(monkeypatch):
    start = Start(ONWARDS, np.zeros(32))
    seen, _ = searches(
        monkeypatch,
        True,
        lambda order, count: start,
    )
    assert len(seen) == 1
    seen, _ = searches(
        monkeypatch,
        False,
        lambda order, count: start if count > 100 else None,
    )
    assert len(seen) == 2


def test_that_several_zeros_explain_a_motion_ends_its_search(monkeypatch):
    def several(*_):
        raise CalibrationError('the motion does not determine the zeros: many explain it')

    monkeypatch.setattr(
        zero_search,
        '_explaining',
        several,
    )
    means = SimpleNamespace(readings=np.tile(np.arange(4.0), (10, 1)))
    with pytest.raises(CalibrationError, match='many explain it'):
        find_start(means, model_of())


def test_a_quarter_of_the_guesses_is_improved_to_the_end(monkeypatch):
    """Two of eight, whose zeros are far apart, for each of sixteen combinations of directions."""
    exact, model = some_readings(40)
    far = np.random.default_rng(8).uniform(-3.0, 3.0, (8, 4))
    far[0] = 0.01
    monkeypatch.setattr(zero_search, 'sensor_angles', lambda **_: exact[0] + far)
    found = search_zeros(exact, model.layout, 8)
    assert 16 < len(found) <= 32
    assert found[0].direction == ONWARDS
    assert np.abs(found[0].zeros).max() < 1e-4


def test_the_search_is_by_the_first_four_sensors(monkeypatch):
    """Samples that are far from each other by these; a fifth sensor may be anywhere."""
    exact, _ = some_readings(300)
    fifth = 100.0 * np.random.default_rng(9).normal(size=(300, 2))
    given = []

    def search(readings, layout, count):
        given.append(readings)
        return [ZeroGuess(ONWARDS, np.zeros(4), 0.001)]

    monkeypatch.setattr(zero_search, 'search_zeros', search)
    zero_search._guesses(np.column_stack([exact, fifth]), model_of(6).layout, 1)
    zero_search._guesses(exact, model_of().layout, 1)
    np.testing.assert_array_equal(given[0], given[1])
    assert 100 < len(given[0]) < 200
