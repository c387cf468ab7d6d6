# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientations are published: limits, monitors of symptoms, fault isolation, the supervisor.

Imports parameters, kinematics and the top-level modules; no clock, no I/O, no ROS.
"""

from spm_haptic_master.supervision.recording import supervise, Supervised

__all__ = ['Supervised', 'supervise']
