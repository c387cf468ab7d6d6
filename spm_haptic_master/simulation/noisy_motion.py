# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Joint angles as the sensors of a rig that follows a trajectory measure them, before counts.

The inverse kinematics of the rig's own mechanism gives the true angles.
"""

from __future__ import annotations

from math import radians, remainder
import random

from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.exceptions import SettingError, UnreachableError
from spm_haptic_master.kinematics import measured_angles, zxz_quaternion, zxz_rotation
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.rig import make_rig, Rig
from spm_haptic_master.simulation.steering import Steering
from spm_haptic_master.simulation.trajectories import Trajectory

# Times at which a motion is tried before it begins: their number, and the span over which they
# are spread (s), in which the sweep meets every combination of its three periods.
TRIALS = 500
TRIAL_SPAN = 1309.0


class NoisyMotion:
    """
    Measured angles of a rig's sensors with the errors of their rig and without counts.

    The motion goes forward: play depends on where the joint was at the times asked for before.

    Parameters
    ----------
    trajectory : callable
        Time in s to (psi, theta, phi) in rad.
    rig : Rig
        Mechanism and sensors.
    seed : int
        Seed of the noise: the same seed gives the same noise.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    Attributes
    ----------
    rig : Rig
        As given.
    steering : Steering
        Leads the motion away from its trajectory.

    """

    def __init__(
        self,
        trajectory: Trajectory,
        rig: Rig,
        seed: int,
        working_mode: tuple[int, int, int],
    ):
        self.rig = rig
        self.steering = Steering(trajectory)
        self._gauss = random.Random(seed).gauss
        self._working_mode = working_mode
        delays = {sensor.delay for sensor in rig.sensors}
        self._delays = sorted(delays)
        # Angle of each encoder's shaft, rad; None before the first.
        self._shafts: list[float | None] = [None] * len(rig.sensors)

    def joints(self, t: float) -> tuple[float, ...]:
        """
        Return the true angles of the sensors.

        Parameters
        ----------
        t : float
            Time, s into the motion.

        Returns
        -------
        tuple of N float
            Joint angles, rad, in the order of ALL_JOINT_NAMES.

        Raises
        ------
        UnreachableError
            The mechanism does not reach the pose.

        """
        return measured_angles(
            zxz_rotation(*self.steering(t)),
            self.rig.geometry,
            self._working_mode,
            len(self.rig.sensors),
        )

    def orientation(self, t: float) -> tuple[float, float, float, float]:
        """Return the true R_base_platform, quaternion x, y, z, w, `t` seconds into the motion."""
        return zxz_quaternion(*self.steering(t))

    def angles(self, t: float) -> tuple[float, ...]:
        """
        Return the angles as measured: with delay, play, harmonics, noise and resolution.

        Parameters
        ----------
        t : float
            Time, s into the motion; not before that of an earlier call.

        Returns
        -------
        tuple of N float
            Readings, rad, in the order of ALL_JOINT_NAMES.

        Raises
        ------
        UnreachableError
            The mechanism does not reach the pose.

        """
        joints = {}
        for delay in self._delays:
            joints[delay] = self.joints(t - delay)
        readings = []
        for index, sensor in enumerate(self.rig.sensors):
            angle = joints[sensor.delay][index]
            readings.append(self._reading(index, angle))
        return tuple(readings)

    def _reading(self, index: int, joint: float) -> float:
        """Return what an encoder reads at the angle of its joint, rad."""
        sensor = self.rig.sensors[index]
        angle = joint
        if sensor.play:
            angle = self._trailing(index, joint)
        reading = sensor.with_harmonics(angle)
        reading += self._gauss(0.0, sensor.noise)
        if sensor.resolution:
            steps = round(reading / sensor.resolution)
            return sensor.resolution * steps
        return reading

    def _trailing(self, index: int, joint: float) -> float:
        """Return the angle of an encoder's shaft: it trails its joint by half the play at most."""
        before = self._shafts[index]
        half = 0.5 * self.rig.sensors[index].play
        lag = 0.0
        if before is not None:
            lag = remainder(before - joint, TURN)
        angle = joint + min(max(lag, -half), half)
        self._shafts[index] = angle
        return angle


def make_motion(values: Values) -> NoisyMotion:
    """
    Return the motion of checked settings; a trajectory is tried before it begins.

    Parameters
    ----------
    values : Values
        Checked values of the `sim.*` settings, the geometry, `working_mode` and `sensors`.

    Raises
    ------
    SettingError
        The mechanism does not reach the fixed pose, or a pose of the trajectory; as of `make_rig`.
    InputError
        As of `make_rig`.

    """
    name = values['sim.trajectory']
    trajectory = _trajectory(values)
    rig = make_rig(values)
    mode = values['working_mode']
    trials = TRIALS
    if name == 'fixed':
        trials = 1
    try:
        for trial in range(trials):
            t = trial * TRIAL_SPAN / TRIALS
            measured_angles(
                rotation=zxz_rotation(*trajectory(t)),
                geometry=rig.geometry,
                working_mode=mode,
                sensors=len(rig.sensors),
            )
    except UnreachableError as error:
        if name == 'fixed':
            raise SettingError(
                name='sim.pose_deg',
                value=list(values['sim.pose_deg']),
                expected='a pose within reach',
            ) from error
        raise SettingError(
            name='sim.trajectory',
            value=name,
            expected='a motion within reach of the simulated mechanism',
        ) from error
    return NoisyMotion(
        trajectory=trajectory,
        rig=rig,
        seed=values['sim.seed'],
        working_mode=mode,
    )


def _trajectory(values: Values) -> Trajectory:
    """Return the motion that `sim.trajectory` names."""
    pose = map(radians, values['sim.pose_deg'])
    tilt = radians(values['sim.tilt_max_deg'])
    by_name = {
        'fig9': trajectories.fig9,
        'perturbed': trajectories.perturbed,
        'sweep': trajectories.sweep(tilt),
        'hand': trajectories.hand,
        'tour': trajectories.tour,
        'arms': trajectories.arms,
        'fixed': trajectories.fixed(*pose),
    }
    return by_name[values['sim.trajectory']]
