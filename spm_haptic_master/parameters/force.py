# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the force feedback, of `fkm`."""

from __future__ import annotations

from spm_haptic_master.parameters.setting import Setting

# What `force.engaged_by` may be.
BY_TELEOP, BY_OPERATING_STATE = 'teleop', 'operating_state'

FORCE_SETTINGS = (
    Setting('force.enabled', bool, 'compute motor torques, with the topics of the force feedback',
            default=False),
    Setting('force.without_drives', bool, 'render without drives of this package: the motor '
            'torques are the effort of crtk/measured_js, for another motor controller',
            default=False),
    Setting('force.motors', int, 'number of motors: 3 (on th1A, th1B, th1C) or 4 (on th3A, too)',
            default=3, allowed=(3, 4)),
    Setting('force.engaged_by', str, f"what engages force: '{BY_TELEOP}': teleop_state, which "
            f"needs a hand on the handle; '{BY_OPERATING_STATE}': ENABLED, for a client that "
            'looks after the hand by itself', default=BY_TELEOP,
            allowed=(BY_TELEOP, BY_OPERATING_STATE)),
    Setting('force.torque_limit', float, 'largest torque asked of the handle, N m',
            default=0.3, minimum=0.001, maximum=10.0),
    Setting('force.motor_torque_limit', float, 'largest torque of a motor, N m',
            default=0.5, minimum=0.001, maximum=10.0),
    Setting('force.slew', float, 'largest slope of the torque asked of the handle, N m/s',
            default=10.0, minimum=0.01, maximum=1000.0),
    Setting('force.ramp', float, 'time over which torque comes up after engaging, s',
            default=0.5, minimum=0.01, maximum=10.0),
    Setting('force.damping', float, 'viscous damping added at the handle, N m s/rad',
            default=0.005, minimum=0.0, maximum=0.1),
    Setting('force.wrench_timeout', float, 'oldest wrench that is rendered, s',
            default=0.03, minimum=0.002, maximum=0.2),
    Setting('force.small_torque', float, 'largest torque of a wrench with which force may begin, '
            'N m', default=0.05, minimum=0.0001, maximum=1.0),
    Setting('force.protection_limit_deg', float, 'largest protection level of an orientation that '
            'force relies on, deg', default=1.0, minimum=0.01, maximum=30.0),
    Setting('force.noise_limit', float, 'largest noise of an encoder over its sigma_deg (unit 1)',
            default=5.0, minimum=1.0, maximum=100.0),
    Setting('force.speed_limit', float, 'fastest handle, rad/s: beyond it torque fades out',
            default=10.0, minimum=0.1, maximum=100.0),
    Setting('force.sigma_off', float, 'smallest singular value of the motors (unit 1) up to which '
            'three motors render nothing of their weak direction', default=0.05, minimum=0.01,
            maximum=1.0),
    Setting('force.sigma_full', float, 'smallest singular value of the motors (unit 1) above '
            'which they render all of it', default=0.15, minimum=0.01, maximum=1.0),
    Setting('force.lock_stiffness', float, 'stiffness of a locked orientation, N m/rad',
            default=1.0, minimum=0.0, maximum=2.0),
    Setting('force.gravity_handle', float, 'mass times offset from the centre of what turns with '
            'the platform, in the platform frame, kg m', default=(0.0,) * 3, minimum=-1.0,
            maximum=1.0, count=3),
    Setting('force.gravity_proximal', float, 'the same of the proximal links A, B, C: along Z2k '
            'and along Z1k x Z2k, kg m', default=(0.0,) * 6, minimum=-1.0, maximum=1.0, count=6),
    Setting('force.gravity_down', float, 'acceleration of gravity in the base frame, m/s^2',
            default=(0.0, 0.0, -9.80665), minimum=-20.0, maximum=20.0, count=3),
)
