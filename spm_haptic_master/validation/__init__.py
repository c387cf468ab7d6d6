"""
Recorded orientations against motion capture: reading, alignment, error figures and pictures.

Imports kinematics and the top-level modules; no ROS. matplotlib and the readers of rosbag2 files
are extras.
"""
