"""
Which orientation may go out: limits, symptoms of a faulty sensor, and the supervisor that decides.

Imports kinematics and the top-level modules; no clock, no I/O, no ROS.
"""
