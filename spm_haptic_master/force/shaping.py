# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the arriving torque passes on its way: the largest torque, a ramp and the slew rate."""

from __future__ import annotations

from math import sqrt

from spm_haptic_master.kinematics.number_backends import Vector

NOTHING: Vector[float] = (0.0, 0.0, 0.0)


def smoothstep(x: float) -> float:
    """Return 0 below 0, 1 above 1, and 3 x^2 - 2 x^3 between them: continuous in its slope."""
    if x <= 0.0:
        return 0.0
    return 1.0 if x >= 1.0 else x * x * (3.0 - 2.0 * x)


def clipped(value: float, limit: float) -> float:
    """Return a value within -limit and limit; of a product with a ratio, only rounding is cut."""
    return -limit if value < -limit else limit if value > limit else value


def size(vector: Vector[float]) -> float:
    """Return the length of a vector."""
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


class Shaper:
    """
    Torque on the handle after limit, ramp and slew rate; the ramp precedes the slew rate.

    So the slope of what comes out is the slew rate at most, whatever arrives and whenever.

    Parameters
    ----------
    largest : float
        Largest torque on the handle, N m; a larger one keeps its direction.
    slew : float
        Largest slope, N m/s.

    Attributes
    ----------
    torque : tuple of three float
        N m, in the base frame.

    """

    __slots__ = ('_largest', '_slew', 'torque')

    def __init__(self, largest: float, slew: float) -> None:
        self._largest, self._slew = largest, slew
        self.torque = NOTHING

    def restart(self) -> None:
        """Begin from zero torque."""
        self.torque = NOTHING

    def take(self, asked: Vector[float], ramp: float, dt: float,
             beside: Vector[float] = NOTHING) -> Vector[float]:
        """
        Return the torque after one period.

        Parameters
        ----------
        asked : tuple of three float
            N m, in the base frame.
        ramp : float
            Share of it, 0 to 1.
        dt : float
            Time since the last call, s.
        beside : tuple of three float
            What is added to that share: the sum is limited, too, N m.

        """
        x, y, z = asked
        px, py, pz = self.torque
        whole = x * x + y * y + z * z
        if whole > self._largest * self._largest:
            ramp *= self._largest / sqrt(whole)
        x, y, z = ramp * x, ramp * y, ramp * z
        if beside is not NOTHING:
            x, y, z = x + beside[0], y + beside[1], z + beside[2]
            whole = size((x, y, z))
            if whole > self._largest:
                share = self._largest / whole
                x, y, z = share * x, share * y, share * z
        dx, dy, dz = x - px, y - py, z - pz
        step, most = dx * dx + dy * dy + dz * dz, self._slew * dt
        part = most / sqrt(step) if step > most * most else 1.0
        self.torque = torque = px + part * dx, py + part * dy, pz + part * dz
        return torque


class Lasting:
    """
    How long a condition has been true without a break.

    Parameters
    ----------
    limit : float
        Time after which it is too long, s.

    """

    __slots__ = ('_limit', '_time')

    def __init__(self, limit: float) -> None:
        self._limit, self._time = limit, 0.0

    def take(self, condition: bool, dt: float) -> bool:
        """Return whether the condition has lasted too long; `dt` is the period, s."""
        self._time = self._time + dt if condition else 0.0
        return self._time >= self._limit

    def restart(self) -> None:
        """Forget the time."""
        self._time = 0.0
