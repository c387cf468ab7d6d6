# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classic forward model: complete against an independent search, and where it could miss."""

import functools
import math

from built_mechanism import nominal, random_built, random_nominal
import mechanism
import numpy as np
import pytest
from readings import pose_of_zero
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics import assembly_modes
from spm_haptic_master.kinematics.leg_kernels import both_turns
from spm_haptic_master.kinematics.rotations import matrix_from_vector


def search(built, th1, rng):
    """All modes that a damped Newton finds on the closures from many random rotations."""
    second = built.second_axes(th1)
    R = mechanism.random_rotations(rng, 200)
    found = []
    for _ in range(50):
        third = built.third_axes(R)
        f = (second * third).sum(-1) - np.cos(built.beta)
        error = np.abs(f).max(-1)
        for matrix in R[error < 1e-12]:
            if all(np.abs(matrix - other).max() > 1e-5 for other in found):
                found.append(matrix)
        R = R[error > 1e-13]
        third = third[error > 1e-13]
        f = f[error > 1e-13]
        rows = np.cross(third, second)
        damping = 1e-3 * (f**2).sum(-1) + 1e-28
        columns = np.swapaxes(rows, 1, 2)
        normal = columns @ rows + damping[:, None, None] * np.eye(3)
        gradient = columns @ f[..., None]
        step = -np.linalg.solve(normal, gradient)[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-30))
        R = matrix_from_vector(step) @ R
    return found


def nearest(R, others):
    """Return the smallest angle from a rotation to one of others."""
    return min(mechanism.angle_between(R, other) for other in others)


@pytest.mark.parametrize(
    'mode',
    [
        pytest.param(mode, marks=[pytest.mark.slow] * (number not in (0, 5)))
        for number, mode in enumerate(mechanism.MODES[:6])
    ],
)
def test_complete_against_an_independent_search(mode):
    """Every other mechanism is of a design with more modes than the paper's."""
    rng = np.random.default_rng(21)
    counts = set()
    more_modes = {'alpha': 1.05, 'beta': 1.2, 'gamma': 0.87}
    for trial in range(6):
        built = random_built(rng, **more_modes) if trial % 2 else random_built(rng)
        R = built.reachable_rotation(rng)
        th1 = kinematics.inverse(R, built.geometry, mode).theta1
        modes = kinematics.forward_all(th1, built.geometry)
        found = search(built, th1, rng)
        assert nearest(R, modes) < 1e-7
        assert len(found) == len(modes) <= 8
        np.testing.assert_allclose(built.closures(th1, modes), 0.0, atol=2e-12)
        for matrix in modes:
            np.testing.assert_allclose(matrix.T @ matrix, np.eye(3), atol=1e-14)
            assert nearest(matrix, found) < 1e-6
        counts.add(len(modes))
    assert len(counts) > 1


@functools.cache
def singular_poses():
    """Return poses on the singular surface, mechanism and working mode, 16 times."""
    rng = np.random.default_rng(23)
    poses = []
    for trial in range(16):
        built = nominal() if trial % 2 else random_nominal(rng)
        mode = mechanism.MODES[trial % 8]
        determinant = functools.partial(
            kinematics.parallel_determinant, geometry=built.geometry, working_mode=mode
        )
        poses.append((pose_of_zero(determinant, built, rng, 0.3), built, mode))
    return poses


@pytest.mark.parametrize(
    'offset_deg',
    [
        0.0,
        1e-7,
        *(
            pytest.param(offset, marks=pytest.mark.slow)
            for offset in (1e-9, 1e-6, 1e-5, 1e-3, 0.1)
        ),
    ],
)
def test_a_mode_at_a_singularity_is_never_lost(offset_deg):
    distances = []
    axis = np.array([0.36, -0.48, 0.8])
    for pose, built, mode in singular_poses():
        for sign in (1.0, -1.0):
            R = mechanism.turn(sign * math.radians(offset_deg) * axis) @ pose
            th1 = kinematics.inverse(R, built.geometry, mode).theta1
            modes = kinematics.forward_all(th1, built.geometry)
            assert len(modes) <= 8
            distances.append(nearest(R, modes))
            assert np.abs(built.closures(th1, modes)).max() < 2e-12
    # Rounding (2e-15) moves a double root by its square root, a threefold one by its cube root.
    assert max(distances) < 3e-5
    assert sum(distance >= 1e-5 for distance in distances) <= 2


@pytest.mark.parametrize(
    'th2a',
    [
        math.pi,
        math.pi - 1e-12,
        math.pi - 1e-6,
        0.0,
        math.pi / 2.0,
    ],
)
def test_a_root_where_the_half_angle_has_no_tangent(th2a):
    # xi = th2A, and the paper's xi, at 180 deg and elsewhere: all must be alike.
    rng = np.random.default_rng(24)
    tried = 0
    while tried < 8:
        th1a = rng.uniform(-3, 3)
        th3a = rng.uniform(-3, 3)
        R = nominal().chain(0, th1a, th2a, th3a)
        mode = mechanism.MODES[rng.integers(8)]
        try:
            th1 = kinematics.inverse(R, working_mode=mode).theta1
        except UnreachableError:
            continue
        tried += 1
        assert nearest(R, kinematics.forward_all(th1)) < 1e-5


# Mechanism, th1A, th1B, th1C, th2A and two th3A (rad) at which the mechanism closes for both th3A,
# found by Newton's method on the closures of legs B and C.
SHARED_TH2A = [
    (
        nominal(),
        2.471863398292986,
        1.5688000056634006,
        1.8704822478258292,
        -1.7193109970503544,
        3.0841780303724864,
        1.8028612636977943,
    ),
    (
        nominal(1.3549917395094901, 1.1198859780098633, 2.3048541349812073),
        -0.6437003662958186,
        -0.6789278027222777,
        0.6314690148576105,
        -2.470167939559364,
        -1.1267513135475884,
        -0.5877361115926756,
    ),
]


@pytest.mark.parametrize('built, th1a, th1b, th1c, th2a, first, second', SHARED_TH2A)
def test_two_modes_that_share_th2a(built, th1a, th1b, th1c, th2a, first, second):
    # Then L1 M2 = L2 M1, and eq. 3 reads 0 / 0.
    th1 = [th1a, th1b, th1c]
    modes = kinematics.forward_all(th1, built.geometry)
    for th3a in (first, second):
        R = built.chain(0, th1a, th2a, th3a)
        np.testing.assert_allclose(built.closures(th1, R), 0.0, atol=1e-14)
        assert nearest(R, modes) < 1e-6


def test_free_motion_is_reported():
    # alpha = acos(1 / sqrt 3): all Z2k can meet on (1, 1, 1); if gamma = beta the platform spins.
    alpha = math.acos(1.0 / math.sqrt(3.0))
    g = kinematics.Geometry(alpha, 0.5, 0.5)
    with pytest.raises(SingularityError, match='freely'):
        kinematics.forward_all(np.radians([135.0] * 3), g)


def test_tracking_through_figure_10():
    """The self-rotation goes from 45 to 55 deg, across the singularity at 49.36 deg."""
    last = mechanism.zxz(*mechanism.CENTRE, math.radians(45.0))
    for phi in np.radians(np.linspace(45.0, 55.0, 120)):
        R = mechanism.zxz(*mechanism.CENTRE, phi)
        tracked = kinematics.track_mode(kinematics.inverse(R).theta1, last)
        away = math.degrees(abs(phi - mechanism.SINGULAR_PHI))
        if away > 1.0:
            assert not tracked.ambiguous
            assert mechanism.angle_between(tracked.rotation, R) < 1e-9
        assert tracked.ambiguous or away > 0.1
        last = R
    # Just beyond the margin it is not ambiguous, at the double root itself it is.
    for beyond, ambiguous in ((0.0115, False), (0.0, True)):
        R = mechanism.zxz(*mechanism.CENTRE, mechanism.SINGULAR_PHI + beyond)
        assert kinematics.track_mode(kinematics.inverse(R).theta1, R).ambiguous == ambiguous
    with pytest.raises(UnreachableError, match='no assembly mode'):
        kinematics.track_mode(np.radians([-100.0] * 3), np.eye(3))


@pytest.mark.parametrize(
    'equation, nearest',
    [
        ((1.0, 0.0, 2.0), math.pi),
        ((1.0, 0.0, -2.0), 0.0),
        ((0.0, 1.0, 3.0), -0.5 * math.pi),
    ],
)
def test_without_a_solution_the_nearest_turn_twice(equation, nearest):
    for t in both_turns(equation):
        assert abs(math.remainder(t - nearest, 2.0 * math.pi)) < 1e-12


def test_an_equation_without_an_angle_has_two_opposite_turns():
    one, other = both_turns((0.0, 0.0, 0.5))
    assert other - one == pytest.approx(math.pi)


class CountedChain:
    """A chain that counts how often its closures are evaluated."""

    def __init__(self, chain):
        self.chain = chain
        self.evaluations = 0

    def closures(self, th2a, th3a):
        self.evaluations += 1
        return self.chain.closures(th2a, th3a)


@functools.cache
def closed_chains():
    """Return six chains that close, with the passive angles of leg A for which they do."""
    rng = np.random.default_rng(25)
    found = []
    while len(found) < 6:
        th1a, th2a, th3a = rng.uniform(-3.0, 3.0, 3)
        R = nominal().chain(0, th1a, th2a, th3a)
        try:
            th1 = kinematics.inverse(R).theta1
        except UnreachableError:
            continue
        th1[0] = th1a
        chain = assembly_modes.checked_chain(th1, nominal().geometry)
        if abs(kinematics.parallel_determinant(R)) > 0.1:
            found.append((chain, th2a, th3a))
    return found


@pytest.mark.parametrize('number', range(6))
def test_newtons_method_needs_a_few_steps(number):
    """From 1 deg away each step squares the error: 1e-2, 1e-4, 1e-8, 1e-16."""
    chain, th2a, th3a = closed_chains()[number]
    for away in ((0.02, 0.01), (-0.02, 0.015), (0.01, -0.02)):
        counted = CountedChain(chain)
        found2, found3, error, _ = assembly_modes.polish(counted, th2a + away[0], th3a + away[1])
        assert (found2, found3) == pytest.approx((th2a, th3a), abs=1e-11)
        assert error < assembly_modes.ROUNDING
        assert counted.evaluations <= 8


@pytest.mark.parametrize('number', range(3))
def test_the_rates_of_the_closures_are_their_differences(number):
    chain, th2a, th3a = closed_chains()[number]
    step = 1e-5
    th2a += 0.3
    b, b2, b3, c, c2, c3 = chain.closures(th2a, th3a)
    after = np.array(chain.closures(th2a + step, th3a))
    before = np.array(chain.closures(th2a - step, th3a))
    assert (after - before)[[0, 3]] / (2.0 * step) == pytest.approx([b2, c2], abs=1e-8)
    after = np.array(chain.closures(th2a, th3a + step))
    before = np.array(chain.closures(th2a, th3a - step))
    assert (after - before)[[0, 3]] / (2.0 * step) == pytest.approx([b3, c3], abs=1e-8)
    *_, determinant = assembly_modes.polish(chain, th2a, th3a)
    found2, found3, _, _ = assembly_modes.polish(chain, th2a, th3a)
    _, b2, b3, _, c2, c3 = chain.closures(found2, found3)
    assert determinant == pytest.approx(b2 * c3 - b3 * c2)


@pytest.mark.parametrize(
    'sizes',
    [
        (0.2, 0.5),
        (0.5, 0.2),
    ],
)
@pytest.mark.parametrize(
    ('sine', 'count'),
    [
        (0.9e-3, 2),
        (1.1e-3, 1),
        (-1.1e-3, 1),
    ],
)
def test_equations_are_parallel_below_a_thousandth(sizes, sine, count):
    """Then both solutions of the one that is better determined are tried."""
    small, large = sizes
    first = (small, 0.0, -0.5 * small)
    second = (large * math.sqrt(1.0 - sine * sine), large * sine, -0.6 * large)
    found = assembly_modes.common_turns(first, second)
    assert len(found) == count
    if count == 2:
        # 0.5 or 0.6 is their cosine.
        cosine = 0.5 if small > large else 0.6
        for turn in found:
            assert math.cos(turn) == pytest.approx(cosine, abs=2e-3)


@pytest.mark.parametrize(
    ('sine', 'cosine'),
    [
        (0.6, 0.8),
        (0.6, -0.8),
        (-0.6, -0.8),
    ],
)
def test_two_equations_have_their_common_turn(sine, cosine):
    first = (1.0, 0.0, -cosine)
    second = (0.3, 2.0, -0.3 * cosine - 2.0 * sine)
    for equations in ((first, second), (second, first)):
        (turn,) = assembly_modes.common_turns(*equations)
        assert (math.cos(turn), math.sin(turn)) == pytest.approx((cosine, sine))
        assert assembly_modes.eliminant(*equations) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize('scale', [1e-16, 1.0, 1e16])
@pytest.mark.parametrize('scaled', [0, 1])
def test_the_roots_are_those_of_equations_of_any_size(scaled, scale):
    chain, _, _ = closed_chains()[0]
    expected = assembly_modes.eliminant_roots(chain.turn_equations)

    def equations(cosine, sine):
        found = list(chain.turn_equations(cosine, sine))
        found[scaled] = tuple(scale * part for part in found[scaled])
        return found

    roots = assembly_modes.eliminant_roots(equations)
    assert sorted(roots) == pytest.approx(sorted(expected), abs=1e-6)
