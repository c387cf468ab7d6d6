# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated rig and motion that checked settings describe."""

from __future__ import annotations

from math import radians

from spm_haptic_master.exceptions import SettingError, UnreachableError
from spm_haptic_master.parameters.geometry import (
    geometry_from,
)
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.rig import perfect_rig, random_rig, Rig, Tolerances
from spm_haptic_master.simulation.rig_file import read_rig

# Times at which a motion is tried before it begins: their number, and the span over which they
# are spread (s), in which the sweep meets every combination of its three periods.
TRIALS, TRIAL_SPAN = 500, 1309.0
# Fraction of that span between two of them (unit 1): the golden section fills it evenly.
TRIAL_STEP = 0.6180339887


def make_rig(values: Values) -> Rig:
    """
    Return the rig of checked settings.

    Raises
    ------
    SettingError
        Both a file and a seed are given.
    InputError
        The file cannot be read, or has a value that a rig cannot have; the random deviations make
        an impossible mechanism.

    """
    geometry, noise = geometry_from(values), radians(values['sim.noise_deg'])
    path, seed, sensors = values['sim.rig_file'], values['sim.rig_seed'], values['sensors']
    if path and seed:
        raise SettingError('sim.rig_seed', seed, f'0 with a sim.rig_file ({path})')
    if path:
        return read_rig(path, geometry, noise, sensors)
    if seed:
        return random_rig(seed, Tolerances(
            *map(radians, (*values['sim.tolerance_deg'], *values['sim.harmonics_deg']))),
            geometry, noise, sensors)
    return perfect_rig(geometry, noise, sensors)


def make_motion(values: Values) -> NoisyMotion:
    """
    Return the motion of checked settings.

    Raises
    ------
    SettingError
        The mechanism does not reach the fixed pose, or a pose of the trajectory.
    InputError
        As of `make_rig`.

    """
    name, pose = values['sim.trajectory'], values['sim.pose_deg']
    trajectory = {
        'fig9': trajectories.fig9,
        'perturbed': trajectories.perturbed,
        'sweep': trajectories.sweep(radians(values['sim.tilt_max_deg'])),
        'hand': trajectories.hand,
        'tour': trajectories.tour,
        'fixed': trajectories.fixed(*map(radians, pose)),
    }[name]
    rig = make_rig(values)
    # A motion goes forward: the one that is returned has not begun yet.
    tried, motion = (NoisyMotion(trajectory, rig, values['sim.seed'], values['working_mode'])
                     for _ in range(2))
    try:
        for trial in range(TRIALS if name != 'fixed' else 1):
            tried.joints(TRIAL_SPAN * (trial * TRIAL_STEP % 1.0))
    except UnreachableError as error:
        if name == 'fixed':
            raise SettingError('sim.pose_deg', list(pose), 'a pose within reach') from error
        raise SettingError('sim.trajectory', name,
                           'a motion within reach of the simulated mechanism') from error
    return motion
