# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the drives of the motors."""

from __future__ import annotations

from spm_haptic_master.parameters.setting import ANY_COUNT, Setting

# Values of a list for several drives.
EACH = 'one value for all drives, or one for each'
DRIVE_SETTINGS = (
    Setting('drives.interface', str, 'python-can interface of the drives', default='socketcan'),
    Setting('drives.channel', str, "channel of that interface, such as 'can1'; that of the "
            'encoders for one bus; empty: no drives', default='', blank=True),
    Setting('drives.bitrate', int, 'bit rate of the bus, bit/s, to set it (if the interface can) '
            'and to check the bus load; 0: unknown', default=0, minimum=0, maximum=1000000),
    Setting('drives.node_id', int, 'CANopen node ids of the drives of th1A, th1B, th1C and, with '
            'four motors, th3A', default=(11, 12, 13), minimum=1, maximum=127, count=ANY_COUNT),
    Setting('drives.master_id', int, 'node id of this master in its heartbeat', default=126,
            minimum=1, maximum=127),
    Setting('drives.combined', bool, 'one frame with all torques, and the controlwords apart: '
            'for a bus with the encoders', default=False),
    Setting('drives.mode', int, 'mode of operation 6060h: 10 cyclic synchronous torque, 4 profile '
            'torque; 0: 10, or 4 where it is missing', default=0, allowed=(0, 10, 4)),
    Setting('drives.rated_torque', float, f'rated torque of the motor, N m: torques on the bus '
            f'are per mille of it; {EACH}; has to be given with drives.channel', default=(0.0,),
            minimum=0.0, maximum=100.0, count=ANY_COUNT),
    Setting('drives.torque_unit', float, 'unit of 6076h, rated torque, N m: 0.001 by CiA 402, '
            '0.000001 of drives that have uN m; 0: the drives have no such object, or it is no '
            'torque; drives.rated_torque is not compared then', default=1e-3,
            minimum=0.0, maximum=1.0),
    Setting('drives.gear', float, f'turns of the motor for one of the joint; {EACH}',
            default=(1.0,), minimum=0.01, maximum=1000.0, count=ANY_COUNT),
    Setting('drives.direction', int, 'sign of the torque of a motor against that of the joint; '
            f'{EACH}', default=(1,), allowed=(1, -1), count=ANY_COUNT),
    Setting('drives.torque_limit', float, 'largest torque at a joint, N m: commands are limited '
            'to it, and 6072h of the drives is', default=0.5, minimum=0.001, maximum=100.0),
    Setting('drives.speed_limit', float, 'largest speed of a joint, rad/s, for 6080h in 1/min of '
            'the motor; 0: 6080h is left', default=0.0, minimum=0.0, maximum=1000.0),
    Setting('drives.status_period', float, 'time between two status frames of a drive, s, whole '
            'ms', default=0.004, minimum=0.001, maximum=0.1),
    Setting('drives.status_timeout', float, 'time without a status frame that is a fault, s',
            default=0.02, minimum=0.002, maximum=1.0),
    Setting('drives.heartbeat', float, 'time between two heartbeats, of the drives and of this '
            'master, s, whole ms', default=0.02, minimum=0.001, maximum=1.0),
    Setting('drives.heartbeat_timeout', float, 'time without a heartbeat after which a drive '
            'disables its motor, and which is a fault here, s, whole ms', default=0.06,
            minimum=0.002, maximum=1.0),
    Setting('drives.event_timer', float, 'time without a torque frame after which a drive '
            'disables its motor (1400h:05), s, whole ms; 0: the drives have no such timer, the '
            'heartbeat has to do', default=0.01, minimum=0.0, maximum=1.0),
)
