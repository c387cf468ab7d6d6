# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mechanism as a value: its zeros, its frames, and what is no mechanism."""

from contextlib import nullcontext
import copy
import math
import pickle

from built_mechanism import ALPHA, BETA, Built, GAMMA, nominal, random_built
from mechanism import turn
import numpy as np
import pytest
from readings import all_angles
from spm_haptic_master.exceptions import GeometryError
from spm_haptic_master.kinematics import Geometry, in_usual_frames, workspace_pose


@pytest.mark.parametrize(
    'angles',
    [
        (ALPHA, BETA, GAMMA),
        (0.7, 1.1, 0.9),
        (1.2, 0.8, 2.0),
        (0.9, 0.9, 0.01),
    ],
)
def test_nominal_axes_are_the_nominal_mechanism(angles):
    as_built = nominal(*angles).geometry
    g = Geometry(*angles)
    np.testing.assert_allclose(as_built.platform_axes, g.platform_axes, atol=1e-15)
    assert as_built.base_axes == g.base_axes
    np.testing.assert_allclose(as_built.chain, g.chain, atol=1e-15)
    R = workspace_pose(0.1, 0.2, 0.3)
    if angles[0] == ALPHA:
        expected = all_angles(R, g)
        np.testing.assert_allclose(all_angles(R, as_built), expected, atol=1e-12)


DRAWN = random_built(np.random.default_rng(198))
AGAIN = Built(
    DRAWN.base,
    DRAWN.platform,
    DRAWN.alpha,
    DRAWN.beta,
)


@pytest.mark.parametrize(
    ('g', 'same'),
    [
        (DRAWN.geometry, AGAIN.geometry),
        (Geometry(), Geometry(*np.radians([39.3, 34.1, 18.2]))),
    ],
    ids=['as built', 'nominal'],
)
def test_a_mechanism_is_a_value(g, same):
    assert g is not same
    assert g == same
    assert hash(g) == hash(same)
    for copied in (pickle.loads(pickle.dumps(g)), copy.deepcopy(g)):
        assert copied == g
        assert copied.chain == g.chain
    assert eval(repr(g), {'Geometry': Geometry}) == g
    for name in ('alpha', 'alphas', 'legs', 'other'):
        with pytest.raises(AttributeError, match=name):
            setattr(g, name, 1.0)


def test_a_mechanism_as_built_has_angles_of_each_leg_and_no_nominal_ones():
    built = DRAWN.geometry
    assert Geometry() != built
    np.testing.assert_allclose(built.alphas, DRAWN.alpha)
    np.testing.assert_allclose(built.betas, DRAWN.beta)
    for name in ('alpha', 'beta', 'gamma'):
        with pytest.raises(GeometryError, match=f'{name} of a mechanism as built'):
            getattr(built, name)


GOOD = nominal()


@pytest.mark.parametrize(
    'name, value, quoted',
    [
        ('base_axes', np.zeros((2, 3, 3)), r'\(2, 3, 3\)'),
        ('base_axes', None, 'None'),
        ('base_axes', np.full((3, 3), np.nan), 'nan'),
        ('base_axes', 1.001 * GOOD.base, r'row 0 = \[0.0, 0.0, 1.001\] has length 1.001'),
        ('base_axes', 0.0 * GOOD.base, 'length 0'),
        ('base_axes', GOOD.base[[0, 0, 2]], 'rows 0 and 1 .*parallel to 0 deg'),
        (
            'base_axes',
            GOOD.base[[0, 1, 1]] * [[1], [1], [-1]],
            'rows 1 and 2 .*parall',
        ),
        (
            'base_axes',
            GOOD.base * [[1], [1], [-1]],
            r'Z1C = \[.*-1.0, .*\] is opposite to',
        ),
        ('platform_axes', GOOD.platform[[0, 1, 1]], 'rows 1 and 2 .*parallel'),
        (
            'platform_axes',
            [[0, 0, -1], [1, 0, 0], [0, 1, 0]],
            'Z3A = .* is opposite to',
        ),
        ('alpha', [0.7, 0.7], r'\(2,\)'),
        ('alpha', 0.7, r'\(\)'),
        ('alpha', [0.7, 0.0, 0.7], 'alpha of leg B = 0.0'),
        ('alpha', [39.3, 39.4, 39.1], 'alpha of leg A = 39.3'),
        ('beta', [0.6, 0.6, math.pi], 'beta of leg C = 3.14'),
        ('beta', 'x', 'x'),
    ],
)
def test_impossible_mechanisms(name, value, quoted):
    arguments = {
        'base_axes': GOOD.base,
        'platform_axes': GOOD.platform,
        'alpha': GOOD.alpha,
        'beta': GOOD.beta,
        name: value,
    }
    with pytest.raises(GeometryError, match=quoted) as caught:
        Geometry.from_axes(**arguments)
    assert name in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('degrees, accepted', [(0.11, True), (0.09, False)])
def test_axes_apart_by_the_least_angle(degrees, accepted):
    angle = math.radians(degrees)
    first, second, third = GOOD.base
    near = turn([angle, 0.0, 0.0]) @ first
    opposite = turn([0.0, angle, 0.0]) @ -second
    answer = nullcontext()
    if not accepted:
        answer = pytest.raises(GeometryError, match='deg or more between them')
    for other in (near, opposite):
        base = [first, other, third]
        with answer:
            Geometry.from_axes(base, GOOD.platform, GOOD.alpha, GOOD.beta)


def test_axes_in_single_precision_are_normalised():
    base = GOOD.base.astype(np.float32)
    platform = GOOD.platform.astype(np.float32)
    g = Geometry.from_axes(base, platform, GOOD.alpha, GOOD.beta)
    lengths = np.linalg.norm(g.platform_axes, axis=1)
    np.testing.assert_allclose(lengths, 1.0, atol=1e-15)


# The nominal mechanism, and others that are built at random.
RANDOM = np.random.default_rng(300)
MECHANISMS = [nominal(), *(random_built(RANDOM) for _ in range(20))]


@pytest.mark.parametrize('built', MECHANISMS)
def test_in_the_usual_frames_the_base_has_zeros_and_the_platform_is_as_drawn(built):
    there = in_usual_frames(built.geometry)
    assert there.base_axes[0] == (0.0, 0.0, 1.0)
    across, out_of_plane, _ = there.base_axes[1]
    assert out_of_plane == 0.0
    assert across > 0.0
    # Where the sum of squares is least, no small turn reduces it.
    axes = np.array(there.platform_axes)
    drawn = np.array(Geometry().platform_axes)
    gradient = np.cross(axes, drawn).sum(0)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-14)
    turned = axes @ turn([0.1, 0.0, 0.2]).T
    least = ((axes - drawn) ** 2).sum()
    assert least < ((turned - drawn) ** 2).sum()


def test_the_nominal_mechanism_is_in_the_usual_frames():
    there = in_usual_frames(nominal().geometry)
    np.testing.assert_allclose(there.platform_axes, nominal().platform, atol=1e-15)


@pytest.mark.parametrize('built', MECHANISMS)
def test_the_usual_frames_are_the_same_from_any_other_frames(built):
    rng = np.random.default_rng(301)
    outer = turn(0.3 * rng.normal(size=3))
    inner = turn(0.3 * rng.normal(size=3))
    other = Built(
        built.base @ outer.T,
        built.platform @ inner.T,
        built.alpha,
        built.beta,
    )
    there = in_usual_frames(built.geometry)
    again = in_usual_frames(other.geometry)
    np.testing.assert_allclose(again.base_axes, there.base_axes, atol=1e-14)
    np.testing.assert_allclose(again.platform_axes, there.platform_axes, atol=1e-14)


@pytest.mark.parametrize('built', MECHANISMS)
def test_in_the_usual_frames_nothing_between_two_axes_changes_nor_their_handedness(built):
    there = in_usual_frames(built.geometry)
    pairs = (
        (there.base_axes, built.base),
        (there.platform_axes, built.platform),
    )
    for found, drawn in pairs:
        axes = np.array(found)
        np.testing.assert_allclose(axes @ axes.T, drawn @ drawn.T, atol=1e-14)
        assert np.linalg.det(axes) == pytest.approx(np.linalg.det(drawn))
