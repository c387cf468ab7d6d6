# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Quality of service of the data topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

# QoS of the data topics: RELIABLE, VOLATILE, KEEP_LAST. A best-effort publisher would never match
# a reliable CRTK client. The depth bridges a scheduling delay of 0.1 s at 1 kHz without loss; a
# sample that waited longer is stale (fkm's max_age).
SAMPLES = QoSProfile(depth=100)
# QoS of CRTK states, commands and lines: RELIABLE, VOLATILE, as their clients have them.
EVENTS = QoSProfile(depth=10)
# QoS of the commands of a slave: RELIABLE, VOLATILE. Few are kept, so that a slave that could not
# read for a time does not get a burst of old ones.
COMMANDS = QoSProfile(depth=5)
# QoS of wrenches: RELIABLE, VOLATILE. Only the newest counts: one that has waited is old.
WRENCHES = QoSProfile(depth=1)
# QoS of `state`: latched, so that a controller that subscribes later gets the present state.
STATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# QoS of what is only displayed: the newest message, and no acknowledgement that a publisher or
# its other subscribers would ever wait for.
DISPLAY = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
