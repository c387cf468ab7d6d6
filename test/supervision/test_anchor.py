# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientation that the next one continues."""

from math import cos, degrees, radians, sin

import numpy as np
import pytest
from spm_haptic_master.supervision.anchor import Anchor
from spm_haptic_master.supervision.sample import Sample
from spm_haptic_master.supervision.symptom import Reason

MS = 1_000_000
# Human motion limit, rad/s; total deviation of an orientation, rad, and its share of the reading
# error with which two solutions meet.
SPEED = 20.0
DEVIATION = 1e-3
FOLD_SHARE = 0.1


def turned(angle):
    """Return the quaternion of a rotation about a fixed axis by deg."""
    half = 0.5 * radians(angle)
    return (0.6 * sin(half), 0.0, 0.8 * sin(half), cos(half))


def discontinuity(anchor, stamp, quaternion):
    """Return the symptom of an orientation that comes at a stamp, ns."""
    sample = Sample(
        stamp=stamp,
        angles=(),
        prior=anchor.prior(stamp),
        bias=(),
        factors=(),
        period=1e-3,
    )
    return anchor.discontinuity(sample, quaternion, DEVIATION)


def after(*angles):
    """Return an anchor that has followed angles, deg, a millisecond apart, and its time, ns."""
    anchor = Anchor(SPEED)
    for index, angle in enumerate(angles):
        anchor.follow(index * MS, turned(angle), FOLD_SHARE)
    return anchor, (len(angles) - 1) * MS


def swept(first, last, steps=100):
    return [first + (last - first) * index / steps for index in range(steps + 1)]


def test_a_quaternion_never_changes_its_sign():
    """Neither over two turns nor after a restart, whichever sign the solver finds."""
    anchor = Anchor(1e9)
    last = None
    for index, angle in enumerate(range(0, 720, 15)):
        if index % 7 == 6:
            anchor.restart()
        found = turned(angle % 360 if index % 2 else angle % 360 - 360)
        assert discontinuity(anchor, index * MS, found) is None
        quaternion = anchor.follow(index * MS, found, FOLD_SHARE).quaternion
        assert quaternion in (found, tuple(-each for each in found))
        if last is not None:
            assert sum(one * other for one, other in zip(quaternion, last, strict=True)) > 0.9
        last = quaternion


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('after_ms', [1, 3, 40])
def test_a_turn_faster_than_a_human_does_not_continue_the_motion(sign, after_ms):
    """Beside six deviations of the orientation."""
    reach = SPEED * after_ms * 1e-3 + 6.0 * DEVIATION
    for factor, continues in ((0.99, True), (1.01, False)):
        anchor, now = after(30.0)
        moved = turned(30.0 + sign * factor * degrees(reach))
        symptom = discontinuity(anchor, now + after_ms * MS, moved)
        assert (symptom is None) == continues
    assert symptom.reason is Reason.DISCONTINUOUS
    assert f'limit {reach:.3f}' in symptom.detail


@pytest.mark.parametrize(('fold_share', 'leads'), [(0.99, True), (1.01, False)])
def test_no_orientation_continues_one_where_two_solutions_may_meet(fold_share, leads):
    """That is where six standard deviations and the bias of a sensor take it."""
    anchor, now = after(*swept(20.0, 26.0))
    anchor.follow(now + MS, turned(27.0), fold_share)
    assert (anchor.prior(now + 2 * MS) is not None) == leads


def test_each_of_two_signs_is_taken_that_is_nearer_to_the_last_quaternion():
    rng = np.random.default_rng(3)
    for _ in range(40):
        pair = rng.normal(size=(2, 4))
        last, found = pair / np.linalg.norm(pair, axis=1, keepdims=True)
        anchor = Anchor(SPEED)
        assert anchor.follow(0, tuple(last), FOLD_SHARE).quaternion == tuple(last)
        place = anchor.follow(MS, tuple(found), FOLD_SHARE)
        expected = found if last @ found > 0.0 else -found
        assert place.quaternion == pytest.approx(tuple(expected))
        assert place.stamp == MS


def test_a_restart_selects_the_next_orientation_as_the_first_one():
    anchor, now = after(*swept(20.0, 26.0))
    assert anchor.prior(now + MS) == anchor.place
    anchor.restart()
    assert anchor.place is None
    assert anchor.prior(now + MS) is None
    assert discontinuity(anchor, now + MS, turned(90.0)) is None


def test_an_orientation_selects_among_solutions_for_a_tenth_of_a_second():
    anchor, now = after(30.0)
    assert anchor.prior(now + 100 * MS) is anchor.place
    assert anchor.prior(now + 100 * MS + 1) is None
    assert Anchor(SPEED).prior(now) is None
