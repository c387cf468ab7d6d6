# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Signs of the motors and friction of the device, from motions of known ones."""

import numpy as np
import pytest
from spm_haptic_master.calibration.motor_bring_up import Friction, identify_friction, motor_sign
from spm_haptic_master.exceptions import CalibrationError, InputError

TRUE = Friction(2e-3, 5e-3, 4e-3)
TIME = np.arange(0.0, 0.4, 1e-3)


def release(torque, friction=TRUE, rest=0.02):
    """Return a release in closed form: from rest, a torque for good, until a handle moves on."""
    moved = np.maximum(TIME - rest, 0.0)
    # I theta'' + b theta' = m - c from rest.
    rate, push = friction.viscous / friction.inertia, torque - np.sign(torque) * friction.dry
    angle = push / friction.viscous * (moved - (1.0 - np.exp(-rate * moved)) / rate)
    return TIME, 0.3 + angle, torque * (TIME > rest)


def test_inertia_and_friction_are_those_of_the_motion():
    found = identify_friction([release(0.02), release(-0.03), release(0.05)])
    assert [found.inertia, found.viscous, found.dry] == pytest.approx(
        [TRUE.inertia, TRUE.viscous, TRUE.dry], rel=0.02
    )
    # Half of what Colgate's and Schenkel's condition allows.
    assert TRUE.stiffest(0.015, 1e-3, 2e-3) == pytest.approx(0.5 * 0.02 / 2.5e-3)
    assert Friction(1.0, -0.01, 0.0).stiffest(0.005, 1e-3, 1e-3) == 0.0


def test_what_determines_no_friction_is_refused_by_its_number():
    with pytest.raises(
        CalibrationError,
        match=r'release 2 turns the handle by 0\.0\d+ rad: '
        r'expected 0\.02 or more; is the handle free\?',
    ):
        identify_friction([release(0.02), release(0.0041)])
    # Of one push without friction, inertia and dry friction look the same.
    parabola = TIME, 4.0 * np.maximum(TIME - 0.02, 0.0) ** 2, 0.016 * (TIME > 0.02)
    with pytest.raises(CalibrationError, match='releases determine 2 of inertia'):
        identify_friction([parabola])
    with pytest.raises(InputError, match='release 1 has 19 samples: expected 20 or more'):
        identify_friction([tuple(each[:19] for each in release(0.02))])
    identify_friction([tuple(each[::20] for each in release(each)) for each in (0.05, 0.1)])


@pytest.mark.parametrize('torque', [0.1, -0.1])
@pytest.mark.parametrize('turn', [0.02, -0.02, 0.0051, -0.0051, 0.0049])
def test_the_sign_of_a_motor_is_that_of_torque_and_turn(torque, turn):
    """From rest at a torque of its own, across the end of a turn."""
    step = np.arange(30) >= 10
    angle = (np.pi - 0.01 + turn * step + np.pi) % (2.0 * np.pi) - np.pi
    expected = 0 if abs(turn) < 0.005 else int(np.sign(torque * turn))
    assert motor_sign(0.3 + torque * step, angle) == expected
    assert motor_sign(np.full(30, 0.3), angle) == 0
    with pytest.raises(InputError, match='a step has 9 samples: expected 10 or more'):
        motor_sign(torque * step[:9], angle[:9])
