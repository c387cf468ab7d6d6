# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Quality of service of the topics, by what is on them.

Data are reliable and volatile; a state is latched for late subscribers; what is only displayed is
best-effort. Two nodes that use one topic take its profile from here, so that DDS connects them.
"""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# Data topics: RELIABLE, VOLATILE, KEEP_LAST. A best-effort publisher never matches a reliable CRTK
# client. The depth bridges 0.1 s at 1 kHz; a sample that waited longer is stale (fkm's max_age).
SAMPLES = QoSProfile(depth=100)
# CRTK states, commands and lines: RELIABLE, VOLATILE, as their clients have them.
EVENTS = QoSProfile(depth=10)
# Commands of a slave: RELIABLE, VOLATILE; few, so that a late reader gets no burst of old ones.
COMMANDS = QoSProfile(depth=5)
# Wrenches: RELIABLE, VOLATILE. Only the newest counts: one that has waited is old.
WRENCHES = QoSProfile(depth=1)
# `state`: latched, so that a controller that subscribes later gets the present state.
STATE = QoSProfile(
    depth=1,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
# Displayed only: the newest message, without an acknowledgement for which a publisher could wait.
DISPLAY = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.BEST_EFFORT,
)
