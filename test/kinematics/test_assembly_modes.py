# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classic forward model: complete against an independent search, and where it could miss."""

import functools
import math

from mechanism import (
    angle_between,
    CENTRE,
    chain,
    closures,
    MODES,
    random_geometry,
    random_rotations,
    reachable_rotation,
    second_axes,
    SINGULAR_PHI,
    turn,
    zxz,
)
import numpy as np
from paper.eq5 import eq5_coefficients
import pytest
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
    """All modes that a damped Newton finds on the three closures from many random rotations."""
    second = np.array(second_axes(th1, g))
    axes = np.array([zxz(2.0 * math.pi * k / 3.0, -g.gamma, 0.0)[:, 2] for k in range(3)])
    R = random_rotations(rng, starts)
    found = []
    for _ in range(steps):
        third = np.einsum('nij,kj->nki', R, axes)
        f = np.einsum('ki,nki->nk', second, third) - math.cos(g.beta)
        for matrix in R[np.abs(f).max(-1) < 1e-12]:
            if all(np.abs(matrix - other).max() > 1e-5 for other in found):
                found.append(matrix)
        R, third, f = (values[np.abs(f).max(-1) > 1e-13] for values in (R, third, f))
        rows = np.cross(third, second)
        damping = 1e-3 * (f**2).sum(-1) + 1e-28
        normal = np.swapaxes(rows, 1, 2) @ rows + damping[:, None, None] * np.eye(3)
        step = -np.linalg.solve(normal, np.einsum('nki,nk->ni', rows, f)[..., None])[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-30))
        R = turns(step) @ R
    return found


def turns(vectors):
    """Matrices of rotation vectors (n, 3)."""
    angle = np.linalg.norm(vectors, axis=-1)[:, None, None] + 1e-30
    k = np.zeros(vectors.shape[:-1] + (3, 3))
    k[:, 2, 1], k[:, 0, 2], k[:, 1, 0] = vectors.T
    k -= np.swapaxes(k, 1, 2)
    return np.eye(3) + np.sin(angle) / angle * k + 2.0 * (np.sin(angle / 2) / angle)**2 * (k @ k)


@pytest.mark.parametrize('mode', [
    MODES[0], *(pytest.param(mode, marks=pytest.mark.slow) for mode in MODES[1:])])
def test_complete_against_an_independent_search(mode):
    rng = np.random.default_rng(21)
    counts = []
    for trial in range(9):
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


@functools.cache
def singular_poses():
    """Pose on the singular surface, direction across it, geometry and working mode, 40 times."""
    rng = np.random.default_rng(23)
    poses = []
    while len(poses) < 40:
        g = Geometry() if len(poses) % 2 else random_geometry(rng)
        mode = MODES[rng.integers(8)]
        found = singular_pose(rng, g, mode)
        if found is not None:
            poses.append((*found, g, mode))
    return poses


@pytest.mark.parametrize('offset_deg', [0.0, 1e-7, *(
    pytest.param(offset, marks=pytest.mark.slow) for offset in (1e-9, 1e-6, 1e-5, 1e-3, 0.1))])
def test_a_mode_at_a_singularity_is_never_lost(offset_deg):
    distances = []
    for pose, axis, g, mode in singular_poses():
        for sign in (1.0, -1.0):
            R = turn(sign * math.radians(offset_deg) * axis) @ pose
            th1 = inverse(R, g, mode).theta1
            modes = forward_all(th1, g)
            assert len(modes) <= 8
            distances.append(min(angle_between(R, matrix) for matrix in modes))
            assert all(np.abs(closures(th1, matrix, g)).max() < 2e-12 for matrix in modes)
    # Rounding (2e-15) moves a double root by its square root, a threefold one by its cube root;
    # one of the 40 poses is near a threefold one.
    assert max(distances) < 3e-5
    assert sum(distance >= 1e-5 for distance in distances) <= 2


def test_a_little_away_from_a_singularity_both_modes_are_there():
    g = Geometry()
    centre = SINGULAR_PHI
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


# Geometry, th1A, th1B, th1C, th2A and two th3A (rad) at which the mechanism closes for both th3A,
# found by Newton's method on the closures of legs B and C.
SHARED_TH2A = [
    (Geometry(),
     2.471863398292986, 1.5688000056634006, 1.8704822478258292, -1.7193109970503544,
     3.0841780303724864, 1.8028612636977943),
    (Geometry(),
     1.3063125233583623, 2.663731064164351, 1.7991379243303298, 3.0623171827563156,
     -2.6883134729345795, -1.0983891400102963),
    (Geometry(1.3549917395094901, 1.1198859780098633, 2.3048541349812073),
     -0.6437003662958186, -0.6789278027222777, 0.6314690148576105, -2.470167939559364,
     -1.1267513135475884, -0.5877361115926756),
    (Geometry(1.2545817780787056, 1.382383506244175, 0.8154576259454274),
     -0.7613047526450702, 2.8363989388641784, -0.4174115663661036, -1.0586880603921358,
     -2.0560201877218534, 0.36293592712885436),
    (Geometry(1.5545337156063033, 1.4649951932847263, 1.2435829294660046),
     0.7236097174668815, 0.5245682401670121, -2.3480487253140607, 0.2519649446420514,
     0.8307500496225755, 1.7860571316315106),
    (Geometry(0.7174129572760963, 1.6960292688498806, 0.7603886255874904),
     -2.9499874239885386, 1.1526210143406908, -2.8883618496809627, 2.284315673831394,
     2.400015593607364, 1.7308440651002446)]


@pytest.mark.parametrize('g, th1a, th1b, th1c, th2a, first, second', SHARED_TH2A)
def test_two_modes_that_share_th2a(g, th1a, th1b, th1c, th2a, first, second):
    # Then L1 M2 = L2 M1, and eq. 3 reads 0 / 0.
    th1 = [th1a, th1b, th1c]
    modes = forward_all(th1, g)
    for th3a in (first, second):
        R = chain(th1a, th2a, th3a, g)
        np.testing.assert_allclose(closures(th1, R, g), 0.0, atol=1e-14)
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
        modes, expected = forward_all(th1, g), search(th1, g, rng, starts=200)
        assert len(modes) == len(expected)
        found += len(modes)
    assert found > 0


def test_free_motion_is_reported():
    # alpha = acos(1 / sqrt 3): all Z2k can meet on (1, 1, 1); if gamma = beta the platform spins.
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
    R = zxz(*CENTRE, SINGULAR_PHI)
    assert track_mode(inverse(R).theta1, R, margin=1e-9).ambiguous


def test_tracking_without_a_mode():
    with pytest.raises(UnreachableError, match='no assembly mode'):
        track_mode(np.radians([-100.0] * 3), np.eye(3))
