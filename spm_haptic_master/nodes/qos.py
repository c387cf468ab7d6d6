# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Quality of service of the data topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile

# RELIABLE, VOLATILE, KEEP_LAST: a CRTK client subscribes reliable, and a best-effort publisher
# would never reach it. The depth bridges a scheduling hiccup of 0.1 s at 1 kHz without loss; what
# waited longer is stale (fkm's max_age).
SAMPLES = QoSProfile(depth=100)
# A controller that comes later gets the state that holds.
STATE = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
