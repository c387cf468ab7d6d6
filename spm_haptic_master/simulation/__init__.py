"""
Simulated motion, encoders and bus, with faults on request.

Imports encoders, kinematics and the top-level modules; no ROS.
"""
