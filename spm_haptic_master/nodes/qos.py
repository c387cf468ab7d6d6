"""Quality of service of the data topics."""

from rclpy.qos import QoSProfile

# RELIABLE, VOLATILE, KEEP_LAST: a CRTK client subscribes reliable, and a best-effort publisher
# would never reach it. The depth bridges a scheduling hiccup of 0.1 s at 1 kHz without loss; what
# waited longer is stale (fkm's max_age).
SAMPLES = QoSProfile(depth=100)
