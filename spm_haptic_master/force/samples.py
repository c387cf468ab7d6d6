# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the force feedback takes with each joint sample, and what it gives back."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from spm_haptic_master.force.force_state import ForceState, Reason
from spm_haptic_master.force.torques import NOTHING
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector


class Drives(Enum):
    """State of all drives together."""

    OFF = 'off'
    OPERATING = 'operating'
    FAULT = 'fault'


class Wrench(NamedTuple):
    """
    The torque that the hand is to feel, as it arrived.

    Attributes
    ----------
    received : int
        Time of its arrival, ns, on the clock of the samples; each message has its own.
    torque : tuple of three float
        About the centre of rotation, N m.
    in_handle : bool
        Whether in the handle's frame; else in the base frame.

    """

    received: int
    torque: Vector[float]
    in_handle: bool = False


class ForceSample(NamedTuple):
    """
    A joint sample with what force feedback has to know of it.

    Attributes
    ----------
    stamp : int
        Time of the sample, ns.
    angles : tuple of float
        Raw angles, rad: th1A, th1B, th1C, th3A, ...; NaN of a sensor without a reading.
    quaternion : tuple of four float or None
        R_base_platform, x, y, z, w; None where no orientation is published.
    velocity : tuple of three float or None
        Angular velocity in the base frame, rad/s, over some 10 ms; None where it is not known, as
        after a gap: no wrench is rendered then.
    protection_level : float
        Of the orientation, rad.
    noise : float
        Largest noise of an encoder over its figure (unit 1).
    wrench : Wrench or None
        The latest one; None before the first.
    sources : int
        Number of publishers of wrenches.
    drives : Drives
        State of the drives.
    motor_torque : tuple of float or None
        Torques that the drives report, N m; None where they report none.
    enabled, engaged, present, clutched : bool
        Force is wanted; teleoperation is engaged; a hand is on the handle; the clutch is pressed.
    lock : tuple of three float
        Torque towards a locked orientation, N m in the base frame: rendered in holding, too.
    weightless : bool
        Whether the weight of handle and links is compensated.

    """

    stamp: int
    angles: tuple[float, ...]
    quaternion: Quaternion[float] | None
    velocity: Vector[float] | None
    protection_level: float = 0.0
    noise: float = 1.0
    wrench: Wrench | None = None
    sources: int = 1
    drives: Drives = Drives.OPERATING
    motor_torque: tuple[float, ...] | None = None
    enabled: bool = True
    engaged: bool = True
    present: bool = True
    clutched: bool = False
    lock: Vector[float] = NOTHING
    weightless: bool = True


class ForceOutput(NamedTuple):
    """
    Motor torques of a sample, and their figures.

    Attributes
    ----------
    state : ForceState
        State of the force feedback.
    motor_torque : tuple of float
        Command to the drives, N m; zeros outside engaged, holding and fading.
    asked : tuple of three float
        Torque asked of the handle after energy share, limit, ramp and slew rate, N m in the base
        frame: without gravity and damping.
    rendered : tuple of three float or None
        Torque that the handle gets, N m in the base frame; None where no orientation is known.
    obstacle : Reason or None
        What keeps force from beginning or going on.
    energy : float
        Energy that the motors may still give, J.
    share : float
        Share of the arriving wrench that the energy leaves, 0 to 1.

    """

    state: ForceState
    motor_torque: tuple[float, ...]
    asked: Vector[float]
    rendered: Vector[float] | None
    obstacle: Reason | None
    energy: float
    share: float
