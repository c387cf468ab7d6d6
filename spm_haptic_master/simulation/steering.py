# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated motion that somebody steers: to a pose on request, and back to its trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, atan2, cos, degrees, exp, hypot, isfinite, pi, radians, remainder, sin, sqrt
from typing import NamedTuple

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.trajectories import Trajectory

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
# The axis (1, 1, 1) and the directions of tilt at azimuth 0 and 90 deg, as in `workspace_pose`.
ALONG = 1.0 / sqrt(3.0)
ACROSS = ((sqrt(1.0 / 2.0), -sqrt(1.0 / 2.0), 0.0),
          (sqrt(1.0 / 6.0), sqrt(1.0 / 6.0), -sqrt(2.0 / 3.0)))


class Place(NamedTuple):
    """
    A pose of the workspace, in coordinates in which a straight line leads from pose to pose.

    Attributes
    ----------
    u, v : float
        Tilt from (1, 1, 1), rad, towards azimuth 0 and 90 deg.
    phi : float
        Self-rotation, rad.

    """

    u: float
    v: float
    phi: float


@dataclass(frozen=True, slots=True)
class Course:
    """
    Motion since one request: what it leads to, and what is left of the distance to it.

    Attributes
    ----------
    begins : float
        Time of the request, s.
    target : Place or None
        Pose that was requested; None for the trajectory.
    offset, rate : Place
        Distance to it when the course begins, rad, and DECAY times that plus its rate of change,
        rad/s: the distance is (offset + rate t) exp(-DECAY t).

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
        # The request that has not begun yet; and the courses, the latest last. A sensor's delay
        # asks for a time before the latest one.
        self._request: tuple[Place | None] | None = None
        self._courses: tuple[Course, ...] = ()
        self._latest = 0.0

    def steer(self, tilt: float, azimuth: float, phi: float) -> None:
        """
        Lead the platform to a pose; the arguments are those of `workspace_pose`, in rad.

        Raises
        ------
        InputError
            The pose is beyond TILT_LIMIT or PHI_LIMITS.

        """
        if not isfinite(azimuth):
            raise InputError(f'azimuth {azimuth:g} rad; expected a finite number')
        if not 0.0 <= tilt <= TILT_LIMIT:
            raise InputError(f'tilt {degrees(tilt):g} deg; expected 0 to {degrees(TILT_LIMIT):g}')
        if not PHI_LIMITS[0] <= phi <= PHI_LIMITS[1]:
            low, high = map(degrees, PHI_LIMITS)
            raise InputError(f'phi {degrees(phi):g} deg; expected {low:g} to {high:g}')
        self._request = (Place(tilt * cos(azimuth), tilt * sin(azimuth), phi),)

    def release(self) -> None:
        """Lead the platform back to its trajectory."""
        self._request = (None,)

    def __call__(self, t: float) -> tuple[float, float, float]:
        """Return psi, theta, phi, rad, at time t, s."""
        request = self._request
        if request is not None and t >= self._latest:
            self._request = None
            self._begin(t, request[0])
        self._latest = max(self._latest, t)
        course = self._course(t)
        if course is None or course.target is None and t > course.begins + SETTLED:
            return self._trajectory(t)
        return _angles(self._place(t))

    def _begin(self, t: float, target: Place | None) -> None:
        here, before = self._place(t), self._place(t - STEP)
        there, earlier = (self._reference(target, time) for time in (t, t - STEP))
        offset, then = _difference(here, there), _difference(before, earlier)
        rate = Place(*(DECAY * now + (now - last) / STEP
                       for now, last in zip(offset, then, strict=True)))
        self._courses = (*self._courses[-1:], Course(t, target, offset, rate))

    def _course(self, t: float) -> Course | None:
        """Return the latest course that has begun at a time."""
        return next((each for each in reversed(self._courses) if each.begins <= t),
                    self._courses[0] if len(self._courses) > 1 else None)

    def _reference(self, target: Place | None, t: float) -> Place:
        return _place(*self._trajectory(t)) if target is None else target

    def _place(self, t: float) -> Place:
        course = self._course(t)
        if course is None:
            return _place(*self._trajectory(t))
        elapsed = t - course.begins
        left = exp(-DECAY * elapsed)
        return Place(*(
            end + (offset + rate * elapsed) * left for end, offset, rate in zip(
                self._reference(course.target, t), course.offset, course.rate, strict=True)))


def _difference(one: Place, other: Place) -> Place:
    """Return one place less another; of the self-rotation the nearer way round."""
    return Place(one.u - other.u, one.v - other.v, remainder(one.phi - other.phi, 2.0 * pi))


def _place(psi: float, theta: float, phi: float) -> Place:
    """Return the place of a pose."""
    axis = sin(theta) * sin(psi), -sin(theta) * cos(psi), cos(theta)
    x, y = (sum(a * b for a, b in zip(axis, across, strict=True)) for across in ACROSS)
    sine = hypot(x, y)
    tilt = atan2(sine, ALONG * sum(axis))
    scale = tilt / sine if sine > 0.0 else 0.0
    return Place(scale * x, scale * y, phi)


def _angles(place: Place) -> tuple[float, float, float]:
    """Return psi, theta, phi of a place."""
    tilt = hypot(place.u, place.v)
    along = cos(tilt) * ALONG
    scale = sin(tilt) / tilt if tilt > 0.0 else 0.0
    x, y, z = (along + scale * (place.u * a + place.v * b)
               for a, b in zip(*ACROSS, strict=True))
    return atan2(x, -y), acos(max(-1.0, min(1.0, z))), place.phi
