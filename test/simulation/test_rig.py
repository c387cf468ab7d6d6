# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated rigs: perfect ones, and random ones with their tolerances."""

from math import radians

from encoder_frames import values
import numpy as np
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.simulation.rig import make_rig, perfect_rig, random_rig, Tolerances

TOLERANCES = Tolerances(0.004, 0.003, 0.002, 0.001)


def test_the_default_rig_is_as_drawn_and_so_is_one_without_tolerances():
    assert make_rig(values('sim')) == perfect_rig(Geometry(), radians(0.04))
    same = make_rig(values('sim', geometry__alpha_deg=40.0, sim__rig_seed=5,
                           sim__tolerance_deg=(0.0, 0.0), sim__harmonics_deg=(0.0, 0.0)))
    assert same.geometry.alphas == Geometry(radians(40.0)).alphas
    np.testing.assert_allclose(same.geometry.platform_axes, Geometry().platform_axes, atol=1e-14)
    assert same.sensors == perfect_rig(Geometry(), radians(0.04)).sensors
    assert not same.has_harmonics
    assert random_rig(3, Tolerances(second_harmonic=0.001)).has_harmonics


def test_the_seed_decides_the_rig_and_more_sensors_leave_the_others():
    assert random_rig(3, TOLERANCES) == random_rig(3, TOLERANCES) != random_rig(4, TOLERANCES)
    four, six = (random_rig(3, TOLERANCES, noise=0.001, sensors=count) for count in (4, 6))
    assert (six.geometry, six.sensors[:4]) == (four.geometry, four.sensors)
    assert len({each.first_harmonic for each in six.sensors}) == 6


def test_random_rigs_have_their_tolerances_in_frames_without_a_reference():
    rigs, drawn = [random_rig(seed, TOLERANCES) for seed in range(1, 401)], Geometry()

    def between(axes):
        """Angles between neighbouring axes, which no choice of a frame changes."""
        axes = np.array(axes)
        return np.arccos((axes * np.roll(axes, -1, axis=0)).sum(1))

    def off(figures):
        return np.array([figures(rig.geometry) for rig in rigs]) - figures(drawn)

    for figures, deviation in (
            (lambda g: np.array(g.alphas + g.betas), 0.004),
            (lambda g: between(g.base_axes), 2.0**0.5 * 0.003),
            (lambda g: between(g.platform_axes), 2.0**0.5 * 0.003)):
        np.testing.assert_allclose(off(figures).std(0), deviation, rtol=0.12)
        np.testing.assert_allclose(off(figures).mean(0), 0.0, atol=0.2 * deviation)
    for name, deviation in (('first_harmonic', 0.002), ('second_harmonic', 0.001)):
        found = np.array([[getattr(sensor, name) for sensor in rig.sensors] for rig in rigs])
        np.testing.assert_allclose(found.std(0), deviation, rtol=0.12)
    for rig in rigs[:20]:
        assert rig.geometry.base_axes[0] == (0.0, 0.0, 1.0)
        assert rig.geometry.base_axes[1][1] == 0.0 < rig.geometry.base_axes[1][0]
        np.testing.assert_allclose(
            np.cross(rig.geometry.platform_axes, drawn.platform_axes).sum(0), 0.0, atol=1e-14)
