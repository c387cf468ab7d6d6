# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Command lines of the programs beside the nodes: arguments in, one call, text and exit code out.

Imports every room; no ROS of its own.
"""
