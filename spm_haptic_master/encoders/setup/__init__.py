# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Setting up CANopen encoders: their objects by SDO, their node ids and bit rate by LSS.

Imports the rest of encoders and the top-level modules; canopen is an extra.
"""
