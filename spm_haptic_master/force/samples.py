# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Inputs and outputs of the force feedback for a joint sample.

The words of its state on the topic `force_state` are made and read here alone. They are a
contract: `off`, `ready`, `engaged`, `holding`, `fading: WHY`, `fault: WHY`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from spm_haptic_master.force.statics import Torques
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector


class ForceCondition(Enum):
    """Whether the motors have torque."""

    OFF = 'off'
    READY = 'ready'
    ENGAGED = 'engaged'
    HOLDING = 'holding'
    FADING = 'fading'
    FAULT = 'fault'


class ForceReason(Enum):
    """Why torque fades out: every word of `force_state` behind a colon."""

    DISABLED = 'disabled'
    DRIVES_OFF = 'drives not in operation'
    DISENGAGED = 'teleoperation not engaged'
    ABSENT = 'no hand on the handle'
    STALE = 'wrench missing or too old'
    DRIVE = 'fault of a drive'
    ANGLE = 'angle of a motor missing'
    NO_ORIENTATION = 'no orientation'
    UNPROTECTED = 'protection level above the limit of force'
    NOISY = 'encoder too noisy'
    SPEED = 'handle too fast'
    NOT_FINITE = 'wrench not finite'
    SOURCES = 'two sources of the wrench'
    ENERGY = 'energy generated'


# Reasons that latch a fault until it is acknowledged; after the others force may begin again.
LATCHED = frozenset(
    (
        ForceReason.DRIVE,
        ForceReason.ANGLE,
        ForceReason.NO_ORIENTATION,
        ForceReason.UNPROTECTED,
        ForceReason.NOISY,
        ForceReason.SPEED,
        ForceReason.NOT_FINITE,
        ForceReason.SOURCES,
        ForceReason.ENERGY,
    )
)
# Reasons for which orientation or motors cannot be relied on: all torque fades with them.
ENDS_ALL = frozenset(
    (
        ForceReason.DRIVE,
        ForceReason.DRIVES_OFF,
        ForceReason.ANGLE,
        ForceReason.NO_ORIENTATION,
        ForceReason.UNPROTECTED,
        ForceReason.NOISY,
        ForceReason.SPEED,
    )
)
# Reasons for which weight and end stop end as well, by the slope of their ramp. With the others
# they stay, because orientation and motors are in order.
ENDS_SUPPORT = frozenset((ForceReason.DISABLED, ForceReason.ENERGY))
# Consecutive messages with a small torque after which force may begin.
SMALL_MESSAGES = 3
# Time in which torque fades out (s); after the fault of a drive it is short, because the torque of
# the other motors has another direction. A wrench that stops arriving gives no torque after 50 ms:
# 30 age, 5 transport, 15 fade.
FADE = 0.015
DRIVE_FADE = 0.003


@dataclass(frozen=True, slots=True)
class ForceState:
    """State of the force feedback, and why."""

    condition: ForceCondition
    why: ForceReason | None = None  # why torque fades out, or has

    @property
    def text(self) -> str:
        """Words of the state, as on the topic `force_state`."""
        word = self.condition.value
        return word if self.why is None else f'{word}: {self.why.value}'

    @property
    def is_fading(self) -> bool:
        """Whether torque fades out: it does so for a reason."""
        return self.why is not None and self.condition is ForceCondition.FADING

    @property
    def has_support(self) -> bool:
        """Whether weight compensation and end stop have torque."""
        if self.why is None:
            return self.condition is not ForceCondition.OFF
        return self.why not in ENDS_ALL and self.why not in ENDS_SUPPORT


OFF = ForceState(ForceCondition.OFF)
READY = ForceState(ForceCondition.READY)
ENGAGED = ForceState(ForceCondition.ENGAGED)
HOLDING = ForceState(ForceCondition.HOLDING)
# Every state, by its words on the topic `force_state`.
FORCE_STATES = {
    state.text: state
    for state in (
        OFF,
        READY,
        ENGAGED,
        HOLDING,
        *(
            ForceState(condition, why)
            for condition in (ForceCondition.FADING, ForceCondition.FAULT)
            for why in ForceReason
        ),
    )
}


class DrivesState(Enum):
    """State of all drives together."""

    OFF = 'off'
    OPERATING = 'operating'
    FAULT = 'fault'


@dataclass(frozen=True, slots=True)
class Wrench:
    """The torque that the hand is to feel, as it arrived."""

    received: int  # time of arrival on the clock of the samples, ns; no two have the same
    torque: Vector[float]  # about the centre of rotation, N m
    in_handle: bool = False  # whether in the handle's frame; else in the base frame


@dataclass(slots=True)  # to freeze it would cost as much as all its fields
class ForceSample:
    """A joint sample and its circumstances."""

    stamp: int  # ns
    angles: tuple[float, ...]  # raw, rad: th1A, th1B, th1C, th3A, ...; NaN without a reading
    quaternion: Quaternion[float] | None  # R_base_platform, x, y, z, w; None if withheld
    # Angular velocity in the base frame, rad/s, over some 10 ms; None where it is not known, as
    # after a gap: no wrench is rendered then.
    velocity: Vector[float] | None
    protection_level: float = 0.0  # of the orientation, rad
    noise: float = 1.0  # largest noise of an encoder over its figure (unit 1)
    wrench: Wrench | None = None  # the latest one; None before the first
    sources: int = 1  # number of publishers of wrenches
    drives: DrivesState = DrivesState.OPERATING
    enabled: bool = True  # force is wanted
    engaged: bool = True  # teleoperation is engaged
    present: bool = True  # a hand is on the handle
    clutched: bool = False  # the clutch is pressed
    lock: Quaternion[float] | None = None  # locked orientation, R_base_platform
    weightless: bool = True  # whether the weight of handle and links is compensated


@dataclass(slots=True)
class ForceOutput:
    """Motor torques of a sample, and their figures."""

    state: ForceState
    motor_torque: tuple[float, ...]  # command to the drives, N m; zeros where none is allowed
    # Torque asked of the handle after energy share, limit, ramp and slew rate, N m in the base
    # frame: without gravity, end stop and damping.
    asked: Vector[float]
    rendered: Vector[float] | None  # what the handle gets of all, N m; None without an orientation
    obstacle: ForceReason | None  # what prevents or ends force
    energy: float  # that the motors may still give, J
    share: float  # of the arriving wrench that the energy leaves, 0 to 1


@dataclass(slots=True)
class Command:
    """The command of a sample, with what the energy of the next ones counts."""

    motor_torque: Torques  # N m
    weight: Vector[float]  # torque on the handle that compensates the weight, N m
    # Torque of the wrench on the handle, N m; None if a lock is in it.
    wrench: Vector[float] | None


# A stamp before every sample (ns).
LONG_AGO = -1 << 100
