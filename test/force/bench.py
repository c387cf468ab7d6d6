# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device at a pose, whose samples force feedback takes one after the other, without a plant."""

from dataclasses import replace
import math

from spm_haptic_master.force import ForceController, ForceLimits, ForceSample, Wrench
from spm_haptic_master.kinematics import inverse, quaternion_from_matrix, workspace_pose
from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector

MS = 1_000_000
POSE = workspace_pose(0.1, 0.4, math.radians(15.0))
STILL = (0.0, 0.0, 0.0)
TORQUE = (0.05, -0.1, 0.2)


def at(R):
    """Return the fields of a sample at a pose: its angles and its orientation."""
    joints = inverse(R)
    return {
        'angles': (*joints.theta1.tolist(), float(joints.theta3a)),
        'quaternion': tuple(quaternion_from_matrix(R).tolist()),
    }


ANGLES = at(POSE)['angles']
QUATERNION = at(POSE)['quaternion']


def turned(angle, axis=(0.0, 1.0, 0.0)):
    """Return the orientation of the bench, turned by an angle (rad) in the base frame."""
    x, y, z = (angle * part for part in axis)
    return multiply_quaternions(quaternion_from_vector(x, y, z), QUATERNION)


class Bench:
    """
    Samples of a device at rest, one a millisecond.

    Attributes
    ----------
    torque : tuple of three float or None
        Of the wrench that arrives with each sample, N m; None: no more wrenches arrive.
    changed : dict
        Fields of the sample that are not those of a healthy device.

    """

    def __init__(self, motors=3, limits=None, **kwargs):
        self.motors = motors
        self.controller = ForceController(
            motors=motors,
            limits=limits or ForceLimits(),
            **kwargs,
        )
        self.now = 0
        self.torque = STILL
        self.wrench = None
        self.changed = {}
        self.outputs = []

    def step(self, milliseconds=1, **changed):
        """Take a sample; return what comes out."""
        self.now += round(milliseconds * MS)
        if self.torque is not None:
            self.wrench = Wrench(self.now, self.torque)
        sample = ForceSample(self.now, ANGLES, QUATERNION, STILL, wrench=self.wrench)
        output = self.controller.take(replace(sample, **self.changed, **changed))
        self.outputs.append(output)
        return output

    def run(self, count, **changed):
        """Take some samples; return the last output."""
        for _ in range(count):
            output = self.step(**changed)
        return output

    def engage(self, torque=TORQUE):
        """Bring force up, and its ramp to its end; return the output."""
        self.torque = STILL
        self.run(120)
        self.torque = torque
        return self.run(600)
