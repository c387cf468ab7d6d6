# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What is on the encoders' bus, and what a frame passes on its way to a joint sample.

Imports python-can and the top-level modules; no ROS, no mechanism.
"""
