# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The executables of the package: name, module whose `main` it runs, and what it is."""

EXECUTABLES = {
    'master': ('nodes.master', 'driver, forward model and diagnostics in one process'),
    'encoder_driver': ('nodes.encoder_driver',
                       'four joint angles from CAN, a recording or a simulation'),
    'fkm': ('nodes.fkm', "joint angles in, the platform's orientation out"),
    'diagnostics': ('nodes.diagnostics', 'nearness of a singularity'),
    'recorder': ('nodes.recorder', 'orientations and joint angles into CSV files'),
    'benchmark': ('tools.benchmark',
                  'latency, CPU and loss of the nodes beside those of a bare relay'),
    'can_scan': ('tools.can_scan', 'what is on the CAN bus, against the configuration'),
    'calibrate': ('tools.calibrate', 'zero counts and noise of the encoders, from a known pose'),
    'sim_bus': ('tools.sim_bus',
                'four simulated CANopen encoders on a CAN bus, with faults on request'),
    'validate': ('tools.validate', 'recorded orientations against motion capture'),
}
"""By name; modules are relative to the package. setup.py reads this file by itself."""
