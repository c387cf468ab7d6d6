# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The law of the command.

    R_cmd = R_m (R_m0^T R_s0)

R_m is the master's rotation now, R_m0 and R_s0 are master's and slave's when the offset was taken,
all in the slave's base frame. A turn of the master turns the slave by the same angle about the
same axis in space; a rotation is never scaled. The tip keeps its position, or pivots about a
trocar.
"""

from __future__ import annotations

from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import scaled
from spm_haptic_master.teleoperation.braking import braking_speed
from spm_haptic_master.teleoperation.command import Command, Motion, Pose
from spm_haptic_master.teleoperation.command_limits import CommandLimits, LimitedRotation
from spm_haptic_master.teleoperation.remote_centre import RemoteCentre
from spm_haptic_master.teleoperation.vectors import FloatQuaternion, norm
from spm_haptic_master.timing import SECOND

# Offset that counts as none (rad): far below the resolution of any encoder.
ALIGNED = 1e-9


class Following:
    """
    One course of the slave, from where master and slave are at a stamp.

    Parameters
    ----------
    limits
        Limits of the commanded rotation.
    align_speed
        Angular speed at which the offset between master and slave shrinks to none, rad/s; 0: the
        offset stays.
    master
        Rotation of the master in the slave's base frame.
    slave
        Measured pose of the slave, which is the first command.
    stamp
        Stamp of the master's rotation, ns.
    centre
        The trocar about which the slave pivots; None: the tip keeps its position.

    """

    def __init__(
        self,
        limits: CommandLimits,
        align_speed: float,
        master: FloatQuaternion,
        slave: Pose,
        stamp: int,
        centre: RemoteCentre | None,
    ) -> None:
        self._limits = limits
        # The offset R_m0^T R_s0, from the master's handle to the slave's instrument.
        self._offset = multiply_quaternions(conjugate(master), slave.rotation)
        self._centre = centre
        self._position = slave.position
        cone = None if centre is None else centre.cone
        self._rotation = LimitedRotation(limits, slave.rotation, cone)
        self._align_speed = align_speed
        # Speed at which the offset shrinks, rad/s; None where it does not.
        self._closing = 0.0 if align_speed else None
        # Stamp of the last command, ns.
        self.stamp = stamp

    @property
    def command(self) -> Command:
        """Return the commanded pose and its motion, in the slave's base frame."""
        rotation = self._rotation.rotation
        angular = self._rotation.velocity
        if self._centre is None:
            return Command(Pose(rotation, self._position), Motion(angular))
        return self._centre.command(rotation, angular)

    def advance(
        self,
        master: FloatQuaternion,
        insertion: float,
        stamp: int,
    ) -> str:
        """
        Command what follows from an orientation of the master.

        Parameters
        ----------
        master
            Rotation of the master in the slave's base frame.
        insertion
            Insertion of the master, m; not used without a trocar.
        stamp
            Stamp of the rotation, ns, above the last one.

        Returns
        -------
        str
            Empty, or the limit that the command would break: there is none then.

        """
        dt = (stamp - self.stamp) / SECOND
        left = 0.0
        if self._closing is not None:
            left = norm(vector_from_quaternion(*self._offset))
            self._shrink_offset(self._closing, left, dt)
        broken = self._turn(multiply_quaternions(master, self._offset), dt)
        if not broken and self._centre is not None:
            broken = self._centre.advance(insertion, dt)
        if broken:
            return broken
        if self._closing is not None:
            # From where the command is: it may not have followed so fast.
            self._offset = multiply_quaternions(conjugate(master), self._rotation.rotation)
            self._closing = max(0.0, left - norm(vector_from_quaternion(*self._offset))) / dt
        self.stamp = stamp
        return ''

    def _turn(self, target: FloatQuaternion, dt: float) -> str:
        """Turn towards a target, or the nearest rotation in the cone; return a broken limit."""
        if self._centre is None:
            cone = None
        else:
            cone = self._centre.cone
        if cone is not None and not cone.contains(target):
            if not self._limits.slews:
                return 'tilt'
            target = cone.within(target, cone.largest)
        return self._rotation.advance(target, dt)

    def _shrink_offset(
        self,
        before: float,
        left: float,
        dt: float,
    ) -> None:
        """Shrink the offset that is left, rad; it shrank at the speed `before`, rad/s."""
        angle = left
        if left <= ALIGNED:
            self._closing = None
        else:
            acceleration = self._limits.acceleration
            braking = braking_speed(left, dt, acceleration)
            angle = min(self._align_speed, before + acceleration * dt, braking) * dt
            self._rotation.restart()
        if left <= angle:
            self._offset = (0.0, 0.0, 0.0, 1.0)
            return
        shrunk = scaled(1.0 - angle / left, vector_from_quaternion(*self._offset))
        self._offset = quaternion_from_vector(*shrunk)
