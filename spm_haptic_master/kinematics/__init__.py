"""The manipulator's mathematics: numpy and the standard library; no clock, no I/O, no ROS."""
