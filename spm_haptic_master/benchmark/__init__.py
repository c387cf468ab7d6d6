"""
Latency, CPU and loss of the nodes beside a bare rclpy relay of the same messages.

Imports nodes, encoders and the top-level modules; matplotlib is an extra.
"""
