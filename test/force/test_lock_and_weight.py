# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What goes on while the clutch is pressed: a locked orientation, and the weight."""

from bench import Bench, STILL
import numpy as np
import pytest
from spm_haptic_master.force import Gravity

LOCK = (0.0, 0.1, 0.0)


def steps(bench, count):
    """Return how far the torque on the handle went in each of the latest samples, N m."""
    felt = np.array([output.rendered for output in bench.outputs[-count:]])
    return np.linalg.norm(np.diff(felt, axis=0), axis=1)


def test_a_lock_is_rendered_beside_the_wrench_and_without_a_step():
    bench = Bench()
    bench.engage((0.1, 0.0, 0.0))
    output = bench.run(60, lock=LOCK)
    np.testing.assert_allclose(output.rendered, (0.1, 0.1, 0.0), atol=1e-12)
    assert steps(bench, 61).max() <= 0.01 + 1e-9


def test_a_lock_holds_while_the_clutch_is_pressed_and_after_it():
    bench = Bench()
    bench.engage((0.1, 0.0, 0.0))
    bench.run(60, lock=LOCK)
    output = bench.run(60, lock=LOCK, clutched=True)
    assert output.state.text == 'holding'
    np.testing.assert_allclose(output.rendered, LOCK, atol=1e-12)
    bench.torque = STILL
    bench.run(30, lock=LOCK)
    assert bench.outputs[-1].state.text == 'engaged'
    felt = np.array([output.rendered for output in bench.outputs[-40:]])
    np.testing.assert_allclose(felt, np.tile(LOCK, (40, 1)), atol=1e-12)


def test_lock_and_wrench_together_are_limited():
    bench = Bench()
    bench.engage((0.3, 0.0, 0.0))
    output = bench.run(100, lock=(0.0, 4.0, 0.0))
    assert np.linalg.norm(output.asked) == pytest.approx(0.3)
    assert output.asked[1] > output.asked[0] > 0.0


def test_a_lock_alone_engages_nothing():
    bench = Bench()
    bench.torque = None
    bench.run(400, lock=LOCK)
    assert bench.outputs[-1].state.text == 'ready'
    assert not any(any(output.motor_torque) for output in bench.outputs)


def test_without_a_velocity_a_lock_is_let_go():
    bench = Bench()
    bench.engage(STILL)
    bench.run(60, lock=LOCK)
    assert bench.run(60, lock=LOCK, velocity=None).asked == STILL


def test_the_compensation_of_weight_goes_and_comes_over_the_ramp():
    bench = Bench(gravity=Gravity(handle=(0.0, 0.0, 0.004)))
    weight = np.linalg.norm(bench.engage(STILL).rendered)
    assert weight > 0.01
    half = np.linalg.norm(bench.run(250, weightless=False).rendered)
    assert half == pytest.approx(0.5 * weight, rel=0.02)
    assert bench.run(300, weightless=False).rendered == STILL
    assert np.linalg.norm(bench.run(510).rendered) == pytest.approx(weight)
    assert steps(bench, 1060).max() < 0.02 * weight
