# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientations are published: limits, monitors of symptoms, fault isolation, the supervisor.

A sample passes `SampleClock` (its time), `SensorsInUse` (which readings exist), `JointMonitors`
(each joint by itself), `SensorSet` (all sensors against each other), `Anchor` (the last
orientation) and `Rivals` (other orientations that may be true). `Supervisor` calls them in this
order and returns one `Verdict`. A symptom that lasts is latched by `FaultLatch`; `Exposure` counts
how long ago each sensor was last checked, and `StateMachine` has the words of `state`.

Imports parameters, kinematics and the top-level modules; no clock, no I/O, no ROS.
"""

from spm_haptic_master.supervision.recording import supervise, Supervised

__all__ = ['Supervised', 'supervise']
