# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientations are published: symptoms, fault isolation, and what an orientation is worth.

A `Sample` passes `SampleClock` (its time), `SensorsInUse` (which readings exist), `JointMonitors`
(each joint by itself), `SensorSet` (all sensors against each other, by its `Solver`), `Anchor`
(the last orientation), `Rivals` (other orientations that may be true) and `UnseenJumps` (steps
that only a joint by itself shows). `Supervisor` calls them in this order and returns one
`Verdict`. A `Symptom` that lasts is latched by `FaultLatch`; a `Trial` shows which other sensors
may take over; `Exposure` counts how long ago each sensor was last checked, and `StateMachine` has
the words of `state`.

The protection level is made in three modules: `parity` tests the sensors against each other,
`protection` bounds what noise, bias and an undetected fault do, the fault to the first order;
`folds` the fault to the second.
Without samples, `checkability` says where in the workspace each sensor can be checked, and
`recording` runs recorded ones.

A sensor is an index in ALL_JOINT_NAMES; a `Place` is an orientation at a time.

Imports parameters, kinematics and the top-level modules; no clock, no I/O, no ROS.
"""

from spm_haptic_master.supervision.recording import supervise, Supervised

__all__ = ['Supervised', 'supervise']
