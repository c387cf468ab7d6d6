# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classic forward model: complete against an independent search, and where it could miss."""

import math

from mechanism import (
    angle_between,
    CENTRE,
    chain,
    closures,
    MODES,
    random_geometry,
    random_rotation,
    reachable_rotation,
    second_axes,
    turn,
    zxz,
)
import numpy as np
import pytest

from paper.eq5 import eq5_coefficients
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics import (
    forward_all,
    Geometry,
    inverse,
    parallel_determinant,
    track_mode,
)

EQ5 = {  # the paper's eq. 5, as printed: powers of x = cos xi and y = sin xi
    (4, 0): '0.0174', (3, 1): '-0.0461', (3, 0): '-0.0114', (2, 2): '0.0371', (2, 1): '0.011',
    (2, 0): '-0.0127', (1, 3): '-0.0365', (1, 2): '-0.00446', (1, 1): '0.0184', (1, 0): '0.00275',
    (0, 4): '0.0318', (0, 3): '-0.0128', (0, 2): '-0.0191', (0, 1): '0.00196', (0, 0): '0.00479'}


def test_eq_5_to_the_printed_digit():
    coefficients = eq5_coefficients(np.radians([90.0, 90.0, 90.0]))
    assert coefficients.shape == (5, 5)
    for (i, j), printed in EQ5.items():
        assert float(f'{coefficients[i, j]:.3g}') == float(printed)
    assert all(coefficients[i, j] == 0.0 for i in range(5) for j in range(5) if i + j > 4)


def test_eq_5_meets_the_circle_at_the_modes():
    # xi is th2A less the turn from the arc A1A2 produced to A2B2, here measured by vectors.
    rng = np.random.default_rng(20)
    g = Geometry()
    for _ in range(20):
        th1 = inverse(reachable_rotation(rng, g)).theta1
        first, (second_a, second_b, _) = np.array([0.0, 0.0, 1.0]), second_axes(th1, g)
        coefficients = eq5_coefficients(th1)
        for R in forward_all(th1):
            third = R @ zxz(0.0, -g.gamma, 0.0)[:, 2]
            assert abs(first @ second_a) < 1.0
            to_b, to_third = np.cross(second_a, second_b), np.cross(second_a, third)
            to_b, to_third = to_b / np.linalg.norm(to_b), to_third / np.linalg.norm(to_third)
            x, y = to_b @ to_third, second_a @ np.cross(to_b, to_third)
            powers = np.array([[x**i * y**j for j in range(5)] for i in range(5)])
            assert abs((coefficients * powers).sum()) < 1e-12


@pytest.mark.parametrize('degrees, phis', [
    (90.0, [-21.816527853, 122.199652679]), (100.0, [-42.000420410, 137.104732959]),
    (-100.0, [])])
def test_golden_assembly_modes(degrees, phis):
    modes = forward_all(np.radians([degrees] * 3))
    assert modes.shape == (len(phis), 3, 3)
    expected = [zxz(*CENTRE, math.radians(phi)) for phi in phis]
    for R in expected:
        assert min(angle_between(R, mode) for mode in modes) < 1e-10


def search(th1, g, rng, starts=400, steps=50):
    """All modes a damped Newton finds on the three closures from many random rotations."""
    second = np.array(second_axes(th1, g))
    axes = np.array([zxz(2.0 * math.pi * k / 3.0, -g.gamma, 0.0)[:, 2] for k in range(3)])
    R = np.array([random_rotation(rng) for _ in range(starts)])
    for _ in range(steps):
        third = np.einsum('nij,kj->nki', R, axes)
        f = np.einsum('ki,nki->nk', second, third) - math.cos(g.beta)
        rows = np.cross(third, second)
        damping = 1e-3 * (f**2).sum(-1) + 1e-28
        normal = np.swapaxes(rows, 1, 2) @ rows + damping[:, None, None] * np.eye(3)
        step = -np.linalg.solve(normal, np.einsum('nki,nk->ni', rows, f)[..., None])[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-30))
        R = turns(step) @ R
    f = np.einsum('ki,nki->nk', second, np.einsum('nij,kj->nki', R, axes)) - math.cos(g.beta)
    found = []
    for matrix in R[np.abs(f).max(-1) < 1e-11]:
        if all(np.abs(matrix - other).max() > 1e-5 for other in found):
            found.append(matrix)
    return found


def turns(vectors):
    """Matrices of rotation vectors (n, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None] + 1e-30
    k = np.zeros(vectors.shape[:-1] + (3, 3))
    k[:, 2, 1], k[:, 0, 2], k[:, 1, 0] = vectors.T
    k -= np.swapaxes(k, 1, 2)
    return np.eye(3) + np.sin(angle) / angle * k + 2.0 * (np.sin(angle / 2) / angle)**2 * (k @ k)


@pytest.mark.parametrize('mode', MODES)
def test_complete_against_an_independent_search(mode):
    rng = np.random.default_rng(21)
    counts = []
    for trial in range(24):
        g = Geometry() if trial % 3 == 0 else random_geometry(rng)
        R = reachable_rotation(rng, g)
        th1 = inverse(R, g, mode).theta1
        modes = forward_all(th1, g)
        counts.append(len(modes))
        assert len(modes) <= 8
        for matrix in modes:
            np.testing.assert_allclose(closures(th1, matrix, g), 0.0, atol=2e-12)
            np.testing.assert_allclose(matrix.T @ matrix, np.eye(3), atol=1e-14)
        assert min(angle_between(R, matrix) for matrix in modes) < 1e-7
        found = search(th1, g, rng)
        assert len(found) == len(modes)
        for matrix in found:
            assert min(angle_between(matrix, other) for other in modes) < 1e-6
    assert len(set(counts)) > 1


def test_eight_modes():
    g = Geometry(*np.radians([60.0, 70.0, 50.0]))
    rng = np.random.default_rng(22)
    eight = 0
    for _ in range(60):
        th1 = inverse(reachable_rotation(rng, g), g).theta1
        modes = forward_all(th1, g)
        if len(modes) == 8:
            eight += 1
            assert all(np.abs(closures(th1, R, g)).max() < 1e-12 for R in modes)
            assert len(search(th1, g, rng)) == 8
    assert eight > 0


def singular_pose(rng, g, mode):
    """Find a pose with det A = 0 and the direction in which it was crossed, or None."""
    R, axis = reachable_rotation(rng, g, slack=0.02), rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    steps = np.linspace(0.0, 0.5, 26)
    values = parallel_determinant(np.array([turn(s * axis) @ R for s in steps]), g, mode)
    with np.errstate(invalid='ignore'):
        crossed = np.flatnonzero(values[:-1] * values[1:] < 0.0)
    if not len(crossed):
        return None
    low, high = steps[crossed[0]], steps[crossed[0] + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if parallel_determinant(turn(middle * axis) @ R, g, mode) * values[crossed[0]] > 0.0:
            low = middle
        else:
            high = middle
    return turn(low * axis) @ R, axis


@pytest.mark.parametrize('offset_deg', [0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3, 0.1])
def test_a_mode_at_a_singularity_is_never_lost(offset_deg):
    rng = np.random.default_rng(23)
    tried = 0
    while tried < 40:
        g = Geometry() if tried % 2 else random_geometry(rng)
        mode = MODES[rng.integers(8)]
        found = singular_pose(rng, g, mode)
        if found is None:
            continue
        tried += 1
        for sign in (1.0, -1.0):
            R = turn(sign * math.radians(offset_deg) * found[1]) @ found[0]
            th1 = inverse(R, g, mode).theta1
            modes = forward_all(th1, g)
            assert len(modes) <= 8
            # Rounding moves a double root by its square root, a threefold one by the cube root.
            assert min(angle_between(R, matrix) for matrix in modes) < 1e-5
            assert all(np.abs(closures(th1, matrix, g)).max() < 2e-12 for matrix in modes)


def test_a_little_away_from_a_singularity_both_modes_are_there():
    g = Geometry()
    centre = math.radians(49.358591780)
    for offset in np.radians([1e-4, 1e-3, 1e-2, 0.1]):
        R = zxz(*CENTRE, centre + offset)
        near = [matrix for matrix in forward_all(inverse(R).theta1, g)
                if angle_between(matrix, R) < 10.0 * offset]
        assert len(near) == 2


@pytest.mark.parametrize('th2a', [math.pi, math.pi - 1e-12, math.pi - 1e-6, 0.0, math.pi / 2.0])
def test_a_root_where_the_half_angle_has_no_tangent(th2a):
    # xi = th2A, and the paper's xi, at 180 deg and elsewhere: all must be alike.
    rng = np.random.default_rng(24)
    g = Geometry()
    tried = 0
    while tried < 25:
        R = chain(rng.uniform(-3, 3), th2a, rng.uniform(-3, 3), g)
        try:
            th1 = inverse(R, g, MODES[rng.integers(8)]).theta1
        except UnreachableError:
            continue
        tried += 1
        assert min(angle_between(R, matrix) for matrix in forward_all(th1, g)) < 1e-5


def test_two_modes_that_share_th2a():
    # Then L1 M2 = L2 M1 and eq. 3 reads 0 / 0. Such triples are found by Newton on the closures of
    # legs B and C at two values of th3A, in th1A, th1B, th1C, th2A.
    rng = np.random.default_rng(25)
    found = 0
    while found < 20:
        g = Geometry() if found % 2 else random_geometry(rng)
        th3 = rng.uniform(-math.pi, math.pi, 2)
        x = rng.uniform(-math.pi, math.pi, 4)

        def residual(x, g=g, th3=th3):
            return np.concatenate(
                [closures(x[:3], chain(x[0], x[3], angle, g), g)[1:] for angle in th3])

        for _ in range(40):
            jac = np.array([(residual(x + h) - residual(x - h)) / 2e-6 for h in 1e-6 * np.eye(4)]).T
            x = x - np.clip(np.linalg.lstsq(jac, residual(x), rcond=None)[0], -0.5, 0.5)
        if np.abs(residual(x)).max() > 1e-14 or abs(math.remainder(th3[0] - th3[1], 6.283)) < 0.1:
            continue
        found += 1
        modes = forward_all(x[:3], g)
        for angle in th3:
            R = chain(x[0], x[3], angle, g)
            assert min(angle_between(R, matrix) for matrix in modes) < 1e-6


def test_second_axes_that_coincide():
    # alpha = 45 deg: Z2A and Z2B can both lie half-way between z and x; arc A2B2 has no direction.
    g = Geometry(*np.radians([45.0, 50.0, 40.0]))
    rng = np.random.default_rng(26)
    half_way = np.array([1.0, 0.0, 1.0]) / math.sqrt(2.0)
    th1a, th1b = math.pi / 2.0, 0.0
    found = 0
    for angle in np.linspace(-3.0, 3.0, 25):
        th1 = np.array([th1a, th1b, angle])
        second_a, second_b, _ = second_axes(th1, g)
        if np.abs(second_b - half_way).max() > 1e-12:
            th1[1] = th1b = math.pi
            second_a, second_b, _ = second_axes(th1, g)
        np.testing.assert_allclose(second_a, half_way, atol=1e-15)
        np.testing.assert_allclose(second_b, half_way, atol=1e-15)
        modes, expected = forward_all(th1, g), search(th1, g, rng)
        assert len(modes) == len(expected)
        found += len(modes)
    assert found > 0


def test_free_motion_is_reported():
    # alpha = acos(1 / sqrt 3): all Z2k can meet on (1, 1, 1); with gamma = beta the platform spins.
    alpha = math.acos(1.0 / math.sqrt(3.0))
    g = Geometry(alpha, 0.5, 0.5)
    th1 = np.radians([135.0, 135.0, 135.0])
    np.testing.assert_allclose(second_axes(th1, g), 1.0 / math.sqrt(3.0), atol=1e-15)
    with pytest.raises(SingularityError, match='freely'):
        forward_all(th1, g)


def test_tracking_through_figure_10():
    # phi = 45 + 10 sin(pi t / 10) deg crosses the singularity at 49.36 deg.
    last = zxz(*CENTRE, math.radians(45.0))
    ambiguous = []
    for phi in np.radians(45.0 + np.linspace(0.0, 10.0, 400)):
        R = zxz(*CENTRE, phi)
        tracked = track_mode(inverse(R).theta1, last)
        ambiguous.append(tracked.ambiguous)
        if abs(phi - math.radians(49.3586)) > math.radians(1.0):
            assert not tracked.ambiguous
            assert angle_between(tracked.rotation, R) < 1e-9
        if abs(phi - math.radians(49.3586)) < math.radians(0.1):
            assert tracked.ambiguous
        last = R
    assert any(ambiguous)


def test_tracking_at_the_double_root_itself_is_ambiguous():
    R = zxz(*CENTRE, math.radians(49.358591780))
    assert track_mode(inverse(R).theta1, R, margin=1e-9).ambiguous


def test_tracking_without_a_mode():
    with pytest.raises(UnreachableError, match='no assembly mode'):
        track_mode(np.radians([-100.0] * 3), np.eye(3))
