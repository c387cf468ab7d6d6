# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A supervised device at rest, sample by sample; the product's limits; few cases of many."""

from dataclasses import replace
from itertools import product

from device import joint_angles
import numpy as np
import pytest
from spm_haptic_master.kinematics import quaternion_from_matrix, workspace_pose
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.fkm import Limits, limits_from, SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.supervisor import make_supervisor

MS = 1_000_000
NAMES = ('th1a', 'th1b', 'th1c', 'th3a', 'th3b', 'th3c')
# Noise, rad, and count of the encoders, rad.
NOISE = np.radians(0.04)
COUNT = 2.0 * np.pi / 2**14


def few(*axes, count=None, others=pytest.mark.slow):
    """
    Return every combination of values as a case; most have the mark of the others.

    Quick is a diagonal on which each value occurs, or the first `count` cases of it.
    """
    sizes = [len(values) for values in axes]
    quick = set()
    for index in range(count or max(sizes)):
        quick.add(tuple(index % size for size in sizes))
    cases = []
    for places in product(*map(range, sizes)):
        values = [axis[place] for axis, place in zip(axes, places, strict=True)]
        marks = () if places in quick else others
        cases.append(pytest.param(*values, marks=marks))
    return cases


def product_limits(**changed) -> Limits:
    """Return the limits of fkm's default parameters, some fields changed."""
    return replace(limits_from(complete(SUPERVISION_SETTINGS, {})), **changed)


class Rig:
    """
    A supervisor and the encoders of a device that rests, with a millisecond between samples.

    `pose` is tilt, azimuth and phi, deg. If `healthy`, it has turned by some degrees and back.
    """

    def __init__(self, sensors=4, pose=(8.0, 30.0, 20.0), healthy=True, **settings):
        self.supervisor = make_supervisor(
            complete(SUPERVISION_SETTINGS, {'sensors': sensors, **settings})
        )
        self.sensors = sensors
        self.now = 1000 * MS
        self._rng = np.random.default_rng(1)
        to_and_fro = 8.0 * np.sin(np.linspace(0.0, np.pi, 200)) ** 2
        turn = np.radians(np.concatenate([to_and_fro, np.zeros(50)]))
        tilt, azimuth, phi = np.radians(pose)
        rotations = workspace_pose(
            np.full(len(turn), tilt),
            np.full(len(turn), azimuth),
            phi + turn,
        )
        path = joint_angles(rotations, sensors)
        self.place = path[-1]
        self._true = tuple(quaternion_from_matrix(rotations[-1]).tolist())
        if healthy:
            for angles in path:
                self._take(angles)
            assert self.state == 'healthy'

    def _take(self, angles, after=1, stamp=None):
        if stamp is None:
            self.now += round(after * MS)
            stamp = self.now
        readings = angles + NOISE * self._rng.normal(size=self.sensors)
        self.verdict = self.supervisor.take(
            stamp, tuple((np.round(readings / COUNT) * COUNT).tolist())
        )
        return self.verdict

    def sample(self, after=1, stamp=None, **moved):
        """Take a sample some ms after the last one, some joints moved by deg; return a verdict."""
        angles = self.place.copy()
        for name, degrees in moved.items():
            angles[NAMES.index(name)] += np.radians(degrees)
        return self._take(angles, after, stamp)

    def samples(self, count, **moved):
        """Take equal samples; return the causes of those that are withheld, None for others."""
        return [
            verdict.cause and verdict.cause.words
            for verdict in (self.sample(**moved) for _ in range(count))
        ]

    def errors(self, count, **moved):
        """Take equal samples; return the errors, deg, of the orientations that are published."""
        verdicts = [self.sample(**moved) for _ in range(count)]
        return [
            np.degrees(rotation_distance(verdict.estimate.quaternion, self._true))
            for verdict in verdicts
            if verdict.estimate is not None
        ]

    @property
    def state(self):
        """Words of the state."""
        return self.verdict.announced.text

    @property
    def left_out(self):
        """Names of the sensors that the orientation is without."""
        return self.verdict.announced.left_out
