"""Quality of service of the data topics."""

from rclpy.qos import QoSProfile

# RELIABLE, VOLATILE, KEEP_LAST: a CRTK client subscribes reliable, and a best-effort publisher
# would never reach it. Ten samples bridge a scheduling hiccup of 10 ms without loss.
SAMPLES = QoSProfile(depth=10)
