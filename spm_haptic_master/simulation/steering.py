# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A simulated motion that is steered: to a pose on request, and back to its trajectory.

The distance to the target decays like a critically damped oscillator, so nothing jumps.
"""

from __future__ import annotations

from collections import deque
from math import atan2, cos, degrees, exp, hypot, isfinite, pi, radians, remainder, sin, sqrt
from operator import mul
from typing import NamedTuple

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.trajectories import ACROSS, tilted, Trajectory

# Largest tilt from the workspace's centre, and range of the self-rotation, that can be steered to
# (rad): the nominal mechanism reaches every pose of them, and so all poses between two.
TILT_LIMIT = radians(20.0)
PHI_LIMITS = radians(-40.0), radians(65.0)
# Rate at which the distance to the target decays (1/s): 40 deg away the platform turns by 1 rad/s
# at most, as a hand does.
DECAY = 4.0
# Time after which nothing of that distance is left (s).
SETTLED = 10.0
# Time over which a velocity is measured (s).
STEP = 1e-4
# Time before any motion (s).
ALWAYS = -1e9


class Place(NamedTuple):
    """
    A pose, in coordinates in which a straight line leads from pose to pose.

    Attributes
    ----------
    u, v : float
        Tilt from (1, 1, 1) towards azimuth 0 and 90 deg, rad.
    phi : float
        Self-rotation, rad.

    """

    u: float
    v: float
    phi: float


class Course(NamedTuple):
    """
    Motion since one request: a distance of (offset + rate t) exp(-DECAY t) to its target.

    Attributes
    ----------
    begins : float
        Time of the request, s.
    target : Place or None
        Pose that was requested; None for the trajectory.
    offset : Place
        Distance when the course begins, rad.
    rate : Place
        DECAY times that plus its rate of change, rad/s.

    """

    begins: float
    target: Place | None
    offset: Place
    rate: Place


class Steering:
    """
    A trajectory that leaves its way when it is steered, without a jump of pose or velocity.

    It is a trajectory itself. One thread may steer it while another asks for poses.

    Parameters
    ----------
    trajectory : callable
        Time in s to (psi, theta, phi) in rad; followed until `steer`, and after `release`.

    """

    def __init__(self, trajectory: Trajectory):
        self._trajectory = trajectory
        # The target of a request that has not begun yet; and the last two courses. A sensor's
        # delay asks for a time before the latest one.
        self._requests: deque[Place | None] = deque(maxlen=1)
        nothing = Place(0.0, 0.0, 0.0)
        self._courses = [
            Course(
                begins=ALWAYS,
                target=None,
                offset=nothing,
                rate=nothing,
            )
        ] * 2
        self._latest = 0.0

    def steer(
        self,
        tilt: float,
        azimuth: float,
        phi: float,
    ) -> None:
        """
        Lead the platform to a pose, given as for `workspace_pose`.

        Parameters
        ----------
        tilt : float
            Tilt of the platform axis from (1, 1, 1), rad.
        azimuth : float
            Direction of the tilt, rad.
        phi : float
            Self-rotation, rad.

        Raises
        ------
        InputError
            The pose is beyond TILT_LIMIT or PHI_LIMITS, or the azimuth is not finite.

        """
        if not isfinite(azimuth):
            raise InputError(f'azimuth {azimuth:g} rad; expected a finite number')
        _check_angle('tilt', tilt, 0.0, TILT_LIMIT)
        least, most = PHI_LIMITS
        _check_angle('phi', phi, least, most)
        target = Place(
            u=tilt * cos(azimuth),
            v=tilt * sin(azimuth),
            phi=phi,
        )
        self._requests.append(target)

    def release(self) -> None:
        """Lead the platform back to its trajectory."""
        self._requests.append(None)

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Return psi, theta, phi, rad, at time t, s."""
        if self._requests and t >= self._latest:
            self._begin(t, self._requests.pop())
        self._latest = max(self._latest, t)
        course = self._course(t)
        if course.target is None and t > course.begins + SETTLED:
            return self._trajectory(t)
        u, v, phi = self._place(t)
        return tilted(hypot(u, v), atan2(v, u), phi)

    def _begin(self, t: float, target: Place | None) -> None:
        """Begin the course to a target at a time, s, from the present pose and velocity."""
        offset = self._difference(t, target)
        before = self._difference(t - STEP, target)
        rates = []
        for now, last in zip(offset, before, strict=True):
            speed = (now - last) / STEP
            rates.append(DECAY * now + speed)
        rate = Place(*rates)
        self._courses = [
            self._courses[1],
            Course(
                begins=t,
                target=target,
                offset=offset,
                rate=rate,
            ),
        ]

    def _difference(self, t: float, target: Place | None) -> Place:
        """Return how far a target is; of the self-rotation the nearer way round."""
        here = self._place(t)
        there = self._reference(target, t)
        return Place(
            u=here.u - there.u,
            v=here.v - there.v,
            phi=remainder(here.phi - there.phi, 2.0 * pi),
        )

    def _course(self, t: float) -> Course:
        """Return the latest course that has begun at a time."""
        before, latest = self._courses
        return latest if latest.begins <= t else before

    def _reference(self, target: Place | None, t: float) -> Place:
        """Return the place of a target at a time, s; that of the trajectory for None."""
        if target is None:
            return place(*self._trajectory(t))
        return target

    def _place(self, t: float) -> Place:
        """Return the place of the motion at a time, s."""
        course = self._course(t)
        elapsed = t - course.begins
        left = exp(-DECAY * elapsed)
        reference = self._reference(course.target, t)
        parts = []
        for end, offset, rate in zip(reference, course.offset, course.rate, strict=True):
            distance = (offset + rate * elapsed) * left
            parts.append(end + distance)
        return Place(*parts)


def _check_angle(
    name: str,
    angle: float,
    least: float,
    most: float,
) -> None:
    """Raise InputError where an angle to steer to is out of its range, rad."""
    if not least <= angle <= most:
        low = degrees(least)
        high = degrees(most)
        raise InputError(f'{name} {degrees(angle):g} deg; expected {low:g} to {high:g}')


def place(
    psi: float,
    theta: float,
    phi: float,
) -> Place:
    """
    Return the place of a pose.

    Parameters
    ----------
    psi, theta, phi : float
        ZXZ angles, rad.

    """
    axis = (
        sin(theta) * sin(psi),
        -sin(theta) * cos(psi),
        cos(theta),
    )
    x, y = (sum(map(mul, axis, across)) for across in ACROSS)
    sine = hypot(x, y)
    if sine > 0.0:
        tilt = atan2(sine, sum(axis) / sqrt(3.0))
        scale = tilt / sine
    else:
        scale = 0.0
    return Place(scale * x, scale * y, phi)
