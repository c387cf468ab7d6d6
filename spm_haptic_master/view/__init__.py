# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The device in a browser: its topics drawn in 3D, and controls for a simulated source.

Imports nodes, ros, simulation, force, description, parameters, kinematics and the top-level
modules; rclpy; and viser, an extra, with the libraries of its server.
"""
