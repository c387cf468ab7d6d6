# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the simulated motion, and how a motion is made from them."""

from __future__ import annotations

from math import radians

from spm_haptic_master.encoders.settings import COUNTS_PER_TURN_SETTING
from spm_haptic_master.exceptions import SettingError, UnreachableError
from spm_haptic_master.geometry_settings import (
    geometry_from,
    GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.kinematics import inverse_angles, zxz_rotation
from spm_haptic_master.settings import Setting, Values
from spm_haptic_master.shared_settings import RATE_SETTING
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.noisy_motion import NoisyMotion

# Settings of the motion.
MOTION_SETTINGS = (
    Setting('sim.trajectory', str, 'simulated motion',
            allowed=('fig9', 'perturbed', 'sweep', 'fixed')),
    Setting('sim.tilt_max_deg', float, 'sweep: largest tilt from the centre, deg',
            minimum=0.0, maximum=26.0),
    Setting('sim.pose_deg', float, 'fixed: psi, theta, phi (ZXZ), deg',
            minimum=-360.0, maximum=360.0, count=3),
    Setting('sim.noise_deg', float, 'standard deviation of each sensor, deg',
            minimum=0.0, maximum=10.0),
    Setting('sim.seed', int, 'seed of the noise; the same seed gives the same noise', minimum=0),
    *GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)

# Settings of the source `sim`.
SIM_SETTINGS = (RATE_SETTING, *MOTION_SETTINGS, COUNTS_PER_TURN_SETTING)


def make_motion(values: Values) -> NoisyMotion:
    """
    Return the motion of checked settings.

    Raises
    ------
    SettingError
        The fixed pose is out of reach.

    """
    geometry = geometry_from(values)
    working_mode = values['working_mode']
    pose = values['sim.pose_deg']
    if values['sim.trajectory'] == 'fixed':
        try:
            inverse_angles(zxz_rotation(*map(radians, pose)), geometry, working_mode)
        except UnreachableError as error:
            raise SettingError('sim.pose_deg', list(pose), 'a pose within reach') from error
    trajectory = {
        'fig9': trajectories.fig9,
        'perturbed': trajectories.perturbed,
        'sweep': trajectories.sweep(radians(values['sim.tilt_max_deg'])),
        'fixed': trajectories.fixed(*map(radians, pose)),
    }[values['sim.trajectory']]
    return NoisyMotion(trajectory, radians(values['sim.noise_deg']), values['sim.seed'],
                       geometry, working_mode)
