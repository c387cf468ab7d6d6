# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motions of simulated rigs for the tests of the calibration from free motion."""

from functools import cache
from math import radians, tau

from mechanism import turn
import numpy as np
from simulated_hand import Condition, deviations_of, hand_motion, joint_angles, readings
from spm_haptic_master.calibration.motion.free_motion import fitted
from spm_haptic_master.calibration.motion.model import Layout, MotionModel
from spm_haptic_master.calibration.motion.readings import motion_readings
from spm_haptic_master.calibration.motion.zero_search import Start
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.rotations import wrapped
from spm_haptic_master.simulation.rig import perfect_rig, random_rig, Tolerances

SIGMA = 7e-4
# Deviations of an ordinary rig.
DEVIATIONS = Tolerances(
    radians(0.3),
    radians(0.3),
    radians(0.12),
    radians(0.015),
)
# A short motion that determines everything that a motion can.
SHORT = Condition('short', seconds=24.0)
# An ordinary rig, and the seed of its short motion.
RIG = random_rig(12, DEVIATIONS)
SEED = 41


@cache
def short_motion():
    """Return stamps, raw readings, true directions and zeros of the short motion of `RIG`."""
    return readings(RIG, SHORT, SEED)


@cache
def short_calibration():
    """Return the calibration from every tenth of its samples, with zeros that are known about."""
    stamps, raw, direction, zeros = short_motion()
    return calibrated(stamps[::10], raw[::10], direction, zeros)


def model_of(sensors=4, nominal=None):
    """Return the model of a rig with a drawing."""
    return MotionModel(Layout(sensors, nominal or Geometry()), np.full(sensors, SIGMA))


def calibrated(stamps, raw, direction, zeros, progress=lambda text, share: None):
    """Return the calibration of a motion whose zeros are known: it saves the search for them."""
    means = motion_readings(stamps, raw)
    layout = Layout(raw.shape[1])
    start = np.zeros(layout.count)
    start[layout.slices['zeros']] = zeros
    return fitted(layout, means, Start(tuple(direction.tolist()), start), progress)


def sensor_errors(found, rig, zeros):
    """Return the largest error of each sensor over the region of a calibration, rad, (N,)."""
    angles = joint_angles(found.region.poses(found.model, found.vector), rig)
    angles = angles[np.isfinite(angles).all(axis=1)]
    corrected = found.model.corrected(angles + deviations_of(rig, angles) + zeros, found.vector)
    return np.abs(wrapped(corrected - angles)).max(axis=0)


def poses(count, seed=3):
    """Return orientations of a motion within reach of rigs near the drawing."""
    found = motion_of_poses(seed)
    return found[:: len(found) // count][:count].copy()


@cache
def motion_of_poses(seed):
    """Return all orientations of that motion."""
    rig = perfect_rig(Geometry(), 0.0)
    condition = Condition('poses', tilt=17.0, turn_from=5.0, turn_to=85.0)
    return hand_motion(rig, condition, seed)


def random_vector(model, seed, size=0.005):
    """Return parameters of a rig near the drawing, with zeros anywhere."""
    random = np.random.default_rng(seed)
    vector = size * random.normal(size=model.layout.count)
    vector[model.layout.slices['second harmonics']] *= 0.1
    zeros = model.layout.slices['zeros']
    vector[zeros] = random.uniform(0.0, tau, model.layout.sensors)
    return vector


def turned_a_little(rotations, seed, size=1e-3):
    """Return orientations off by small rotations."""
    random = np.random.default_rng(seed)
    return np.stack([turn(size * random.normal(size=3)) @ each for each in rotations])
