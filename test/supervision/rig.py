# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A supervisor with a played solver: what the supervisor asks, and makes of the answer."""

from math import cos, radians, sin

from product_limits import product_limits
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_zxz
from spm_haptic_master.supervision.solver import Solution, Solver
from spm_haptic_master.supervision.supervisor import Supervisor

MS = 1_000_000
SIGMA = (radians(0.04),) * 4
# Joint angles, rad, at which all joints rest: th1A, th1B, th1C, th3A.
PLACE = (0.5, 0.5, 0.5, 0.5)
# Turn from one sample to the next that a human can make, rad.
TURN = 0.015
DEVIATION = 1e-3


def turned(angle):
    """Return the quaternion of a rotation by `angle`, rad, about z."""
    return (0.0, 0.0, sin(angle / 2.0), cos(angle / 2.0))


class PlayedSolver:
    """Answers with what a test sets, and records the priors that it is given."""

    def __init__(self):
        joints = inverse(matrix_from_zxz(*map(radians, (135.0, 54.7, 20.0))))
        angles = (*joints.theta1.tolist(), float(joints.theta3a))
        self.four = self.three = Solver(Geometry(), SIGMA).solve(angles, None).estimate._replace(
            quaternion=turned(0.0), parity=0.0, determined=True,
            covariance=(DEVIATION ** 2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        self.priors, self.without_priors, self.missing = [], [], []
        self.error = self.error_of_three = None
        self.apart = 0.0

    def solve(self, angles, prior):
        self.priors.append(prior)
        if self.error is not None:
            raise self.error
        return Solution(self.four, self.apart)

    def without(self, sensor, angles, prior):
        self.missing.append(sensor)
        self.without_priors.append(prior)
        if self.error_of_three is not None:
            raise self.error_of_three
        return self.three


class Rig:
    """A supervisor with a played solver, and a clock that grows by a millisecond a sample."""

    def __init__(self, healthy=True, **limits):
        self.solver = PlayedSolver()
        self.supervisor = Supervisor(self.solver, SIGMA, product_limits(**limits))
        self.now = 0
        self.changes = 0
        if healthy:
            assert [self.sample() for _ in range(10)][-6:] == [''] * 6
            assert self.state == 'healthy'

    def sample(self, *, after=1, stamp=None, **moved):
        """Take a sample, some joints moved; return why it is withheld, '' if it is not."""
        if stamp is None:
            self.now += after * MS
            stamp = self.now
        self.changes += 1
        # Each reading changes a little: none is frozen.
        angles = [angle + (self.changes % 2) * 1e-6 for angle in PLACE]
        for name, value in moved.items():
            angles[('th1a', 'th1b', 'th1c', 'th3a').index(name)] += value
        try:
            self.estimate, self.level = self.supervisor.take(stamp, tuple(angles))
        except RejectedError as rejection:
            self.detail = rejection.detail
            return rejection.reason
        return ''

    @property
    def state(self):
        return self.supervisor.state
