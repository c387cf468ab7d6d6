# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the drives are configured to be: values of the settings in the units of the bus."""

from __future__ import annotations

from dataclasses import dataclass

from spm_haptic_master.drives import cia402
from spm_haptic_master.encoders import canopen


@dataclass(frozen=True, slots=True)
class DrivePlan:
    """One drive and its motor."""

    name: str  # in texts, with joint and node id
    node_id: int  # of CANopen
    rated_torque: float  # of the motor, N m
    scale: float  # per mille of it for 1 N m at the joint, with sign
    cap: int  # largest torque, per mille
    speed_limit: int  # of the motor, 1/min; 0: the drive's own

    def per_mille(self, torque: float) -> int:
        """Return a joint's torque, N m, in per mille of the rated torque, within the cap."""
        return max(-self.cap, min(self.cap, round(self.scale * torque)))


@dataclass(frozen=True, slots=True)
class Plan:
    """All drives on their bus."""

    drives: tuple[DrivePlan, ...]  # in the order of the motors
    combined: bool  # one frame has all torques, controlwords have their own
    mode: int  # of operation; 0: cyclic synchronous torque, else profile torque
    master_id: int  # node id in this master's heartbeat
    torque_unit: float  # of 6076h, N m; 0: the drives have no such object
    period: float  # between two samples, s
    status_period: float  # between two status frames, s
    status_timeout: float  # without one that is a fault, s
    heartbeat: float  # between two, s
    heartbeat_timeout: float  # without one that is a fault, s
    event_timer: float  # without a torque frame until a motor is off, s; 0: none

    @property
    def fall_out(self) -> float:
        """Return the time without frames after which a drive has disabled its motor, s."""
        return self.event_timer or self.heartbeat_timeout

    def status_id(self, drive: DrivePlan) -> int:
        """Return the identifier of a drive's status frame: TPDO1."""
        return canopen.TPDO_BASES[0] + drive.node_id

    def control_id(self, drive: DrivePlan) -> int:
        """Return the identifier of a drive's controlword, with its torque: RPDO1."""
        return canopen.RPDO_BASES[0] + drive.node_id

    @property
    def combined_id(self) -> int:
        """Return the identifier of the frame with all torques: RPDO2 of the first drive."""
        return canopen.RPDO_BASES[1] + self.drives[0].node_id


# Layout of a status frame, bytes: statusword, torque actual, mode display.
STATUS_LENGTH = 5
# Bytes of a controlword, and of a torque.
WORD = 2


def status_of(data: bytes | bytearray) -> tuple[int, int, int]:
    """Return statusword, torque actual (per mille) and mode of operation of a status frame."""
    return (int.from_bytes(data[:2], 'little'), int.from_bytes(data[2:4], 'little', signed=True),
            int.from_bytes(data[4:5], 'little', signed=True))


def torque_bytes(torque: int) -> bytes:
    """Return a torque, per mille, as a frame has it."""
    return torque.to_bytes(WORD, 'little', signed=True)


def torque_frames(plan: Plan, controlwords: list[int], torques: list[int],
                  controls: bool) -> list[tuple[int, bytes]]:
    """
    Return identifier and data of the frames of a sample, with torques in per mille.

    With a combined frame `controls` says whether the controlwords go out, too.
    """
    words = [(plan.control_id(drive), word.to_bytes(WORD, 'little'))
             for drive, word in zip(plan.drives, controlwords, strict=True)]
    encoded = list(map(torque_bytes, torques))
    if not plan.combined:
        return [(identifier, word + torque)
                for (identifier, word), torque in zip(words, encoded, strict=True)]
    return [(plan.combined_id, b''.join(encoded)), *(words if controls else ())]


def mode_words(mode: int) -> str:
    """Return a mode of operation in words."""
    return {cia402.CYCLIC_TORQUE: 'cyclic synchronous torque',
            cia402.PROFILE_TORQUE: 'profile torque'}.get(mode, 'another mode') + f' ({mode})'
