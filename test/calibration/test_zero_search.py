# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The search for zeros and directions of which nothing is known."""

from math import radians

from free_motions import model_of, poses
import numpy as np
import pytest
from spm_haptic_master.calibration.motion import zero_search
from spm_haptic_master.calibration.motion.readings import MotionReadings
from spm_haptic_master.calibration.motion.zero_search import find_start, search_zeros, Start
from spm_haptic_master.exceptions import CalibrationError
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
