# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the picture is made of: the banner, the map of the workspace, plots."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.description.workspace_map import (
    COLOURS,
    HALF_ANGLE,
    UNREACHABLE,
    WorkspaceMap,
)
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    parallel_determinant,
    workspace_pose,
)
from spm_haptic_master.orientation_state import received_state
from spm_haptic_master.parameters.nodes import DIAGNOSTICS_SETTINGS
from spm_haptic_master.view.liveness import banner, Light, STALE_AFTER


@pytest.mark.parametrize(('state', 'age', 'light', 'text', 'alive'), [
    ('', None, Light.GREY, 'waiting for fkm', False),
    ('starting', None, Light.GREY, 'starting', False),
    ('starting', 0.0, Light.AMBER, 'starting', False),
    ('', 0.0, Light.AMBER, 'state unknown: fkm publishes it', False),
    ('healthy', 0.0, Light.GREEN, 'healthy', True),
    ('healthy', STALE_AFTER, Light.GREEN, 'healthy', True),
    # The state is that of the orientations: they go out, and something else is missing.
    ('healthy', 0.3, Light.RED, 'no joint_states for 0.25 s (diagnostics)', False),
    ('healthy', 7.2, Light.RED, 'no joint_states for 7 s (diagnostics)', False),
    ('healthy', None, Light.AMBER, 'healthy, but no joint_states (diagnostics)', False),
    ('starting', 7.2, Light.RED, 'silent: no orientation for 7 s', False),
    ('', 0.3, Light.RED, 'silent: no orientation for 0.25 s', False),
    ('degraded: joint_1b', 0.1, Light.AMBER, 'degraded: joint_1b', True),
    ('degraded: joint_1b', 0.4, Light.RED, 'no joint_states for 0.25 s (diagnostics)', False),
    # What fkm says of a silence is on the page at once, whatever was drawn last.
    ('silent: no joint samples', 0.0, Light.RED, 'silent: no joint samples', False),
    ('silent: joint_3a stuck', None, Light.RED, 'silent: joint_3a stuck', False),
    # Words of another program vouch for nothing.
    ('healthy again', 0.0, Light.RED, "silent: unknown state 'healthy again'", False),
    ('degraded', None, Light.RED, "silent: unknown state 'degraded'", False)])
def test_the_banner_says_what_is_and_no_old_pose_is_alive(state, age, light, text, alive):
    shown = banner(received_state(state) if state else None, age)
    assert (shown.light, shown.text, shown.alive) == (light, text, alive)


def test_the_banner_is_in_time():
    """What stops is grey within half a second, with two ticks and the way to the browser."""
    assert STALE_AFTER + 0.1 < 0.4


def test_no_rate_of_the_joint_angles_looks_like_a_silence():
    """At the lowest rate one of them may be missing."""
    (rate,) = [each for each in DIAGNOSTICS_SETTINGS if each.name == 'joint_states_rate']
    assert STALE_AFTER >= 2.5 / rate.minimum


@pytest.mark.parametrize('phi', [0.0, 45.0, 49.36, 60.0])
def test_the_map_has_the_dexterity_and_the_singularities(phi):
    geometry, phi = Geometry(), radians(phi)
    drawn = WorkspaceMap(geometry, (1, 1, 1))
    centre = np.ones(3) / 3.0 ** 0.5
    tilts = np.arccos(np.clip(drawn.axes @ centre, -1.0, 1.0))
    assert tilts.max() < HALF_ANGLE
    # Evenly over the cone: as many tiles within a part of it as its area has of the whole.
    part = np.mean(tilts < 0.5 * HALF_ANGLE)
    assert part == pytest.approx((1 - np.cos(0.5 * HALF_ANGLE)) / (1 - np.cos(HALF_ANGLE)),
                                 abs=0.01)
    colours = drawn.colours(phi)
    away = drawn.axes - (drawn.axes @ centre)[:, None] * centre
    u, v = (np.array([1.0, -1.0, 0.0]) / 2.0 ** 0.5, np.array([1.0, 1.0, -2.0]) / 6.0 ** 0.5)
    poses = workspace_pose(tilts, np.arctan2(away @ v, away @ u), phi)
    np.testing.assert_allclose(poses[..., 2], drawn.axes, atol=1e-12)
    eta = dexterity(poses, geometry)
    # The nearer to a singularity, the nearer to the first colour.
    red = np.abs(colours - COLOURS[0]).sum(axis=1)
    reached = np.isfinite(eta)
    assert np.array_equal((colours == UNREACHABLE).all(axis=1), ~reached)
    assert red[reached][np.argmin(eta[reached])] == red[reached].min()
    low, high = eta[reached] < 0.01, eta[reached] > 0.1
    assert not low.any() or not high.any() or red[reached][low].max() < red[reached][high].min()

    singular = drawn.singular_axes(phi)
    determinants = parallel_determinant(poses, geometry)
    crossed = np.nanmin(determinants) < 0.0 < np.nanmax(determinants)
    assert bool(len(singular)) == crossed
    if len(singular):
        z = singular @ centre
        out = singular - z[:, None] * centre
        found = workspace_pose(np.arccos(np.clip(z, -1.0, 1.0)), np.arctan2(out @ v, out @ u), phi)
        # 1e-3 is a twentieth of a degree here.
        assert np.abs(parallel_determinant(found, geometry)).max() < 2e-3
