# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The device in a browser: what the topics say, drawn in 3D, and a hand for the simulated source.

Imports nodes, ros, simulation, force, description, parameters, kinematics and the top-level
modules; rclpy; and viser, which is an extra, with what viser serves its page with.
"""
