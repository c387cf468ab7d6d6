# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An `fkm` of the test's own process, with the test in the place of the encoder driver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from harness import stamp
from in_process import Hosted, hosted
import numpy as np
from sensor_msgs.msg import JointState
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.nodes.fkm import Fkm

POSE = kinematics.matrix_from_zxz(*np.radians([130.0, 50.0, 30.0]))
# Time between two samples (s).
PERIOD = 0.005


def angles(rotation: np.ndarray = POSE, sensors: int = 4) -> list[float]:
    """Return what the sensors read at a pose, rad."""
    joints = kinematics.inverse(rotation)
    return [
        *map(float, joints.theta1),
        *map(float, (joints.theta3a, joints.theta3b, joints.theta3c)[: sensors - 3]),
    ]


# What four sensors read far from the singularity.
CLEAR = angles(kinematics.workspace_pose(0.0, 0.0, np.radians(20.0)))


def matrix(quaternion: object) -> np.ndarray:
    """Return the rotation matrix of a message's quaternion."""
    return kinematics.matrix_from_quaternion(
        [quaternion.x, quaternion.y, quaternion.z, quaternion.w]
    )


class FkmRig:
    """Sends samples to a hosted `fkm`, and finds what it answers."""

    def __init__(self, host: Hosted) -> None:
        self.host = host
        self.sent = host.sent

    def send(
        self, position: Sequence[float], names: Sequence[str] | None = None, offset: float = 0.0
    ) -> list:
        """Give a sample stamped now + offset, s; return the orientations with its stamp."""
        names = ALL_JOINT_NAMES[: len(position)] if names is None else names
        sample = JointState(name=[*names], position=[*position])
        sample.header.stamp.sec, sample.header.stamp.nanosec = divmod(
            self.host.time_ns() + round(offset * 1e9), 10**9
        )
        return self.give(sample)

    def give(self, sample: JointState) -> list:
        """Give a sample; return the orientations that it adds with its stamp."""
        before = len(self.sent['orientation'])
        self.host.give('measured_js', sample)
        self.host.run(PERIOD)
        added = self.sent['orientation'][before:]
        assert all(stamp(each) == stamp(sample) for each in added)
        return added

    def send_many(self, count: int, *position: Sequence[float], **more: object) -> list:
        """Give samples of one position after the other, or of one again and again."""
        rows = position if len(position) > 1 else position * count
        return [answer for row in rows for answer in self.send(row, **more)]

    def qualify(self, position: Sequence[float] | None = None) -> None:
        """Send one pose until the sensors are trusted."""
        position = angles() if position is None else position
        assert any(self.send(position) for _ in range(400)), self.reason

    @property
    def state(self) -> str:
        return self.host.last('state').data

    @property
    def reason(self) -> str:
        """Return what is on /diagnostics, and why a sample was rejected last."""
        self.host.run(1.0)
        return (
            f'{self.host.entry("orientation").message} / '
            f'{self.host.figures("orientation").get("last rejected")}'
        )


@contextmanager
def fkm_rig(*settings: str) -> Iterator[FkmRig]:
    """Yield an fkm of this process at 200 Hz, with settings such as 'sensors:=6'."""
    with hosted(Fkm, 'rate:=200.0', *settings, subscribes=True) as host:
        yield FkmRig(host)
