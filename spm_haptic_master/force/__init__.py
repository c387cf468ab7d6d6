# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Force feedback: motor torques for a torque on the handle, their limits, energy and states.

`ForceController` has the state. It lets each sample pass `Obstacles` (may there be force?),
`HandleTorque` (what wrench and `Lock` ask of the handle), `Support` (weight and `EndStop`),
`EnergyBudget` (how much of all that stays passive) and the `Statics` of three or four motors.

Imports kinematics and the top-level modules; no clock, no I/O, no ROS.

Torques on the handle are about the centre of rotation, N m in the base frame where nothing else is
stated; those of the motors follow their joints: th1A, th1B, th1C, and th3A of a fourth motor.
"""

from spm_haptic_master.force.controller import ForceController
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.gravity import Gravity, identify_gravity
from spm_haptic_master.force.rendering import render, Rendered
from spm_haptic_master.force.samples import (
    DrivesState,
    FORCE_STATES,
    ForceCondition,
    ForceOutput,
    ForceSample,
    ForceState,
    Wrench,
)

__all__ = [
    'ForceCondition',
    'DrivesState',
    'FORCE_STATES',
    'ForceController',
    'ForceLimits',
    'ForceOutput',
    'ForceSample',
    'ForceState',
    'Gravity',
    'Rendered',
    'Wrench',
    'identify_gravity',
    'render',
]
