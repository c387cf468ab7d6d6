"""Command-line programs that need no ROS: bring-up, calibration and a simulated bus."""
