# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The executables of the package. setup.py runs this file by itself: it imports nothing."""

# Module, relative to the package, and description of each executable, by name.
EXECUTABLES = {
    'master': ('nodes.master', 'encoder_driver, fkm and diagnostics in one process'),
    'encoder_driver': (
        'nodes.encoder_driver',
        'joint angles from a CAN bus, a recording or a simulation',
    ),
    'fkm': ('nodes.fkm', "joint angles in, the platform's orientation out"),
    'diagnostics': ('nodes.diagnostics', 'dexterity and distance to the nearest singularity'),
    'teleop': (
        'nodes.teleop',
        "orientation in, a slave's commanded orientation out: engaging, clutch, limits",
    ),
    'presence': ('nodes.presence', "a joystick's buttons as presence and clutch, repeated"),
    'sim_slave': ('nodes.sim_slave', 'a simulated slave, to try teleop with'),
    'view': ('view.node', 'the device in a browser'),
    'status': ('nodes.status', 'one screen of what is wrong with the running device'),
    'ros': ('nodes.ros', 'topics, parameters and services, for hosts without the ros2 command'),
    'recorder': ('nodes.recorder', 'orientations and joint angles to CSV files'),
    'can_scan': ('tools.can_scan', 'devices on the CAN bus, compared with the configuration'),
    'can_setup': ('tools.can_setup', 'encoders set up as the driver is configured, by SDO'),
    'calibrate': (
        'tools.calibrate',
        'zero counts, directions, mechanism and noise, from free motion or a jig',
    ),
    'supervise': ('tools.supervise', 'of a recording: share published, parity by region, noise'),
    'force_check': (
        'tools.force_check',
        'a recorded bring-up of force: signs, weight, friction, largest stiffness',
    ),
    'sim_bus': (
        'tools.sim_bus',
        'simulated CANopen encoders on a CAN bus, with faults on request',
    ),
    'validate': ('tools.validate', 'recorded orientations against motion capture'),
    'urdf': ('tools.urdf', 'the mechanism as URDF with meshes, nominal or as built'),
}

# Nodes that `master` runs in one process, and `composed:=false` in one process each.
PIPELINE = ('encoder_driver', 'fkm', 'diagnostics')
# Node that `master` also runs if teleop.run is true.
FOLLOWER = 'teleop'
