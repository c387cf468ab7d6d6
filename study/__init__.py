# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The study of more sensors: what a fifth and a sixth one are worth, drawn into docs/sensors.

Not installed: `make study` runs it from the checkout. Imports kinematics, supervision, validation,
the maps of `paper`, and matplotlib.
"""
