# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Passivity observer and controller at the motors (one-port, Hannaford and Ryu 2002).

The wrench that arrives has been on its way: a spring behind a delay gives more than it took. The
observer counts what the motors took from the hand less what they gave, from the raw differences of
the encoders and the torque that was in force, so that it needs no orientation:

    E = min(E_0 + |m_2|^2 / (2 K_min),  E - tau . dtheta)

with the torque m_2 that is asked of the handle after limit, ramp and slew rate. The bound is what
a spring of K_min may have stored. While E decreases, the share z of the damping grows, and then
the share g of the wrench falls:

    z = smoothstep((1.5 mJ - E) / 1 mJ)        g = smoothstep(1 + E / E_g)

z takes 4 ms or more from 0 to 1, and 20 ms or more back: no jerks of a fast handle. The damping
alone would let a faded spring generate energy for ever in slow motion; the share of the wrench
alone would take most of a stiff wall away.

There is one budget for as long as force is on: neither the clutch nor a wrench that stops renews
it. It comes back by the work of the hand, slowly at rest, and by an acknowledgement.
"""

from __future__ import annotations

from spm_haptic_master.force.statics import smoothstep
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import dot

# E_0, the energy that is given in advance (J): the encoders' noise at rest takes up to a quarter.
ADVANCE = 2e-3
# K_min, the softest spring whose energy counts as stored (N m/rad).
SOFTEST = 0.2
# Energy at which the damping begins (J), which 60 s of noise at rest leave, and the range below it
# in which it becomes whole (J). It begins before energy has been generated, as the wrench needs
# some 30 ms to follow.
DAMPED = 1.5e-3
DAMPING_RANGE = 1e-3
# Power with which the advance comes back at rest (W): a slave that stutters gets no more than the
# advance, what is faded, and 3 mJ in a minute.
REST_POWER = 5e-5
# Shortest times (s) in which the damping becomes whole, and ends.
GROWTH = 4e-3
RELEASE = 20e-3
# E_g, the energy generated at which nothing is left of the wrench (J).
FADED = 20e-3
# Whole damping of the handle and of a motor's joint (N m s/rad). Beyond some 0.1, pi / 2 times the
# inertia of 0.4e-3 kg m^2 about the lightest axis over the velocity's lag of 6 ms, it would swing.
HANDLE_DAMPING = 0.06
JOINT_DAMPING = 0.03
# The budget is spent if less than this share of the wrench (unit 1) is left for this time (s).
LEAST_SHARE = 0.1
LEAST_TIME = 1.0


class EnergyBudget:
    """
    The energy that the motors may still give, and what follows from it.

    Attributes
    ----------
    energy : float
        E, J.
    share : float
        Share g of the wrench that is rendered (unit 1).
    damping : float
        Share z of the damping (unit 1).

    """

    def __init__(self) -> None:
        self.damping = 0.0
        self.restart()

    def restart(self) -> None:
        """Begin with the advance; the damping still decreases slowly."""
        self.energy = ADVANCE
        self.share = 1.0
        # Time for which less than `LEAST_SHARE` of the wrench has been left, s.
        self._useless = 0.0

    def count(
        self,
        given: float,
        asked: Vector[float],
        dt: float,
    ) -> None:
        """
        Count the work of a period, and let the damping and the share follow.

        Parameters
        ----------
        given : float
            Work of the motors, less that of lifting the weight, J.
        asked : tuple of three float
            Torque m_2 that was asked of the handle, N m: it bounds the stored energy.
        dt : float
            Length of the period, s.

        """
        energy = self.energy - given
        if energy > ADVANCE:
            stored = dot(asked, asked) / (2.0 * SOFTEST)
            energy = min(energy, ADVANCE + stored)
        self.energy = energy
        if energy >= DAMPED and self.damping == 0.0:
            self.share = 1.0
            return
        # A fast handle gives and takes the whole range from one period to the next.
        wanted = smoothstep((DAMPED - energy) / DAMPING_RANGE)
        most = self.damping + dt / GROWTH
        least = max(0.0, self.damping - dt / RELEASE)
        self.damping = min(most, max(least, wanted))
        self.share = 1.0 if energy >= DAMPED else smoothstep(1.0 + energy / FADED)

    def recover(self, dt: float) -> None:
        """Let the advance come back during a time at rest, s."""
        if self.energy < ADVANCE:
            self.energy = min(ADVANCE, self.energy + REST_POWER * dt)

    def note_wrench(self, dt: float) -> None:
        """Note a time, s, in which a wrench is rendered: too little of it may be left."""
        self._useless = self._useless + dt if self.share < LEAST_SHARE else 0.0

    @property
    def is_spent(self) -> bool:
        """Whether too little of the wrench has been left for too long."""
        return self._useless >= LEAST_TIME
