# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Encoders and a mechanism that no rig has."""

from refusals.refusal import driver, parameter, REPLAY

ENCODERS = (
    # A mechanism that nobody can build.
    parameter(
        'fkm',
        {'geometry.base_axes': [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0]},
        'geometry.base_axes',
        'no unit vectors, or two parallel ones',
        'they are no axes',
        message=(
            "parameter 'geometry.base_axes' is [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0]; "
            'expected the unit vectors of three axes (base_axes: row 2 = [0.0, 1.0, 1.0] has '
            'length 1.41421356, expected a unit vector)'
        ),
    ),
    parameter(
        'fkm',
        {'geometry.platform_axes': [0.0, 0.6, 0.8, 0.0, 0.6, 0.8, 0.0, 0.0, 1.0]},
        'geometry.platform_axes',
        'no unit vectors, or two parallel ones',
        'they are no axes',
        message=(
            "parameter 'geometry.platform_axes' is [0.0, 0.6, 0.8, 0.0, 0.6, 0.8, 0.0, 0.0, "
            '1.0]; expected the unit vectors of three axes (platform_axes: rows 0 and 1 = '
            '[0.0, 0.6, 0.8] and [0.0, 0.6, 0.8] are parallel to 0 deg, expected 0.1 deg or '
            'more between them)'
        ),
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'geometry.proximal_deg': [39.3, 3.0, 80.0]},
        'geometry.proximal_deg',
        "links and axes that do not meet at the workspace's centre",
        'no such mechanism can be assembled',
        message=(
            "parameter 'geometry.proximal_deg' is [39.3, 3.0, 80.0]; expected a mechanism that "
            "can be assembled at the workspace's centre: there Z1C and Z3C are 36.54 deg "
            'apart, and links of 80 and 34.1 deg span 45.90 to 114.10 deg'
        ),
    ),
    # An encoder that nobody has calibrated.
    parameter(
        'encoder_driver',
        {'source': 'can'},
        'encoders.zero_count',
        'not given',
        "another rig's zero counts give wrong orientations",
        message=(
            "parameter 'encoders.zero_count' is not set; expected the zero counts of your rig, "
            'which nothing but a calibration knows: run `ros2 run spm_haptic_master calibrate '
            '--motion --params-file rig.yaml -o calibration.yaml`, then give `--params-file '
            'calibration.yaml`'
        ),
    ),
    parameter(
        'encoder_driver',
        {**REPLAY, 'encoders.direction_verified': [True, True, True, False]},
        'encoders.direction_verified',
        'false for a joint',
        'a wrong sign of joint_3a is invisible on the centre line',
        message=(
            "parameter 'encoders.direction_verified' is [True, True, True, False]; expected "
            'true for each: the direction of joint_3a is not verified; calibrate at two poses '
            '(calibrate --pose ... --pose ...) and give the file that it writes, or set '
            'encoders.accept_unverified_directions to true to run at WARN'
        ),
    ),
    # Settings of the bus.
    driver(
        'can.interface',
        'carrier_pigeon',
        'unknown to python-can',
        'it cannot be opened',
        message=(
            "parameter 'can.interface' is 'carrier_pigeon'; expected one of ... socketcan..."
        ),
    ),
    *(
        parameter(
            name,
            {'can.interface': 'nonsense'},
            'can.interface',
            'unknown to python-can',
            'it cannot be opened',
            message="parameter 'can.interface' is 'nonsense'; expected one of ... socketcan...",
        )
        for name in ('can_scan', 'sim_bus')
    ),
    driver(
        'can.channel',
        "''",
        'empty',
        'it names no bus',
        message="parameter 'can.channel' is ''; expected a text that is not empty",
    ),
    driver(
        'can.protocol',
        'j1939',
        'another protocol',
        'canopen or raw',
        message="parameter 'can.protocol' is 'j1939'; expected one of canopen, raw",
    ),
    driver(
        'can.timeout',
        0.002,
        'shorter than two periods',
        'every jitter would be a fault',
        rate=100.0,
        message=(
            "parameter 'can.timeout' is 0.002; expected at least two periods, 0.02 s at 100 Hz"
        ),
    ),
    driver(
        'can.sync',
        'produce',
        '`produce` where `encoders.sync_id` is 0',
        'there is no SYNC to produce',
        encoders__sync_id=0,
        message=(
            "parameter 'can.sync' is 'produce'; expected consume where encoders.sync_id is 0 "
            '(the bus has no SYNC)'
        ),
    ),
    driver(
        'rate',
        1000.0,
        'more than `can.bitrate` can carry',
        'frames would be lost',
        can__bitrate=250000,
        message=(
            "parameter 'rate' is 1000.0; expected at most 546 Hz at can.bitrate 250000: a "
            'cycle of SYNC and four answers has up to 435 bits, and 435 bits x 1000 Hz / '
            '250000 bit/s = 174 % bus load, beyond 95 %'
        ),
    ),
    # Identifiers.
    driver(
        'encoders.id',
        [385, 386, 385, 388],
        'the same twice',
        'two joints would be one',
        message=(
            "parameter 'encoders.id' is [385, 386, 385, 388]; expected four different "
            'identifiers; joint_1a and joint_1c both have 0x181'
        ),
    ),
    driver(
        'encoders.id',
        [385, 386, 0x800, 388],
        'more than 11 bits, not `encoders.extended`',
        'no such frame exists',
        message=(
            "parameter 'encoders.id' is [385, 386, 2048, 388]; expected an 11-bit identifier "
            'for joint_1c (0x001 to 0x7FF), or encoders.extended true for it'
        ),
    ),
    driver(
        'encoders.id',
        [385, 386, 0x581, 388],
        '0x580 .. 0x67F, unless `can.protocol` is raw',
        'CANopen uses them for SDO',
        message=(
            "parameter 'encoders.id' is [385, 386, 1409, 388]; expected for joint_1c an "
            'identifier that CANopen has no other use for (0x581: SDO answer of node 1), or '
            'can.protocol raw'
        ),
    ),
    driver(
        'encoders.id',
        [385, 386, 0x77F, 388],
        '0x700 .. 0x77F, unless `can.protocol` is raw',
        'CANopen uses them for heartbeats',
        message=(
            "parameter 'encoders.id' is [385, 386, 1919, 388]; expected for joint_1c an "
            'identifier that CANopen has no other use for (0x77F: heartbeat of node 127), or '
            'can.protocol raw'
        ),
    ),
    driver(
        'encoders.id',
        [385, 386, 0x85, 388],
        '0x080 .. 0x0FF, 0x100, 0x7E4, 0x7E5, unless `can.protocol` is raw',
        'CANopen uses them for SYNC, EMCY, TIME and LSS',
        message=(
            "parameter 'encoders.id' is [385, 386, 133, 388]; expected for joint_1c an "
            'identifier that CANopen has no other use for (0x85: EMCY of node 5), or '
            'can.protocol raw'
        ),
    ),
    driver(
        'encoders.sync_id',
        0x181,
        "an encoder's identifier",
        'a SYNC would be counts',
        message=(
            "parameter 'encoders.sync_id' is 385; expected an identifier that no encoder has "
            '(joint_1a has it)'
        ),
    ),
    *(
        driver(
            'encoders.sync_id',
            identifier,
            "a heartbeat's or EMCY's identifier",
            'it would open a cycle',
            message=(
                f"parameter 'encoders.sync_id' is {identifier}; expected an identifier that "
                f'CANopen has no other use for ({use}), or can.protocol raw'
            ),
        )
        for identifier, use in (
            (0x702, '0x702: heartbeat of node 2'),
            (0x83, '0x83: EMCY of node 3'),
        )
    ),
    driver(
        'encoders.node_id',
        [1, 2, 2, 4],
        'the same twice',
        'two nodes would be one',
        message=("parameter 'encoders.node_id' is [1, 2, 2, 4]; expected four different node ids"),
    ),
    # Layout of the frames.
    driver(
        'encoders.byte_offset',
        [0, 0, 0, 1],
        'beyond the frame',
        'there are no such bytes',
        message=(
            "parameter 'encoders.byte_offset' is [0, 0, 0, 1]; expected a word of 32 bits that "
            'ends within the 4 bytes of encoders.data_length, for joint_3a'
        ),
    ),
    driver(
        'encoders.mask',
        [0, 0, 11, 0],
        'bits with a gap',
        'they are not one number',
        message=(
            "parameter 'encoders.mask' is [0, 0, 11, 0]; expected contiguous bits, for joint_1c"
        ),
    ),
    driver(
        'encoders.counts_per_turn',
        [16384, 16384, 16384, 65536],
        'more than mask or bit length can hold',
        'most of the turn would be missing',
        encoders__mask=[0, 0, 0, 0x3FFF],
        message=(
            "parameter 'encoders.counts_per_turn' is [16384, 16384, 16384, 65536]; expected "
            'what 14 bits can hold, for joint_3a'
        ),
    ),
    driver(
        'encoders.counts_per_turn',
        [16384, 4096, 16384, 16384],
        'half or less of what mask or odd bit length select',
        'most counts would be beyond a turn',
        encoders__mask=[0, 0x3FFF, 0, 0],
        message=(
            "parameter 'encoders.counts_per_turn' is [16384, 4096, 16384, 16384]; expected "
            'more than 8192, as encoders.mask or encoders.bit_length selects 14 bits, for '
            'joint_1b'
        ),
    ),
    driver(
        'encoders.zero_count',
        [0, 0, 16384, 0],
        '`encoders.counts_per_turn` or more',
        'there is no such count',
        message=(
            "parameter 'encoders.zero_count' is [0, 0, 16384, 0]; expected counts below the "
            '16384 of encoders.counts_per_turn, for joint_1c'
        ),
    ),
    driver(
        'encoders.direction',
        [1, 1, 0, 1],
        'other than 1 and -1',
        'it is a sign',
        message=(
            "parameter 'encoders.direction' is [1, 1, 0, 1]; expected a list of 4, each one of "
            '1, -1 (sensors: 4)'
        ),
    ),
    driver(
        'encoders.harmonic_cos_deg',
        [0.1, 0.1, 0.1],
        'not as many values as `sensors`',
        'each encoder has its own',
        message=(
            "parameter 'encoders.harmonic_cos_deg' is [0.1, 0.1, 0.1]; expected a list of 4, "
            'each a number from -10 to 10 (sensors: 4)'
        ),
    ),
    driver(
        'encoders.counts_per_turn',
        [16384] * 4,
        'not as many values as `sensors`',
        'each encoder has its own',
        sensors=6,
        message=(
            "parameter 'encoders.counts_per_turn' is [16384, 16384, 16384, 16384]; expected a "
            'list of 6, each an integer from 2 to 2.14748e+09 (sensors: 6)'
        ),
    ),
    driver(
        'encoders.table_deg.joint_3a',
        [0.1, 0.2],
        'a table of fewer than 5 values',
        'they show no second harmonic',
        message=(
            "parameter 'encoders.table_deg.joint_3a' is [0.1, 0.2]; expected what an encoder "
            'can have, for joint_3a (a table of 2 values, expected 5 to 4096)'
        ),
    ),
    driver(
        'encoders.table_deg.joint_3a',
        [5.0, -5.0] * 16,
        'a table that is not monotonic',
        'a reading would be of two angles',
        message=(
            "parameter 'encoders.table_deg.joint_3a' is [5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, "
            '-5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, '
            '-5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0, 5.0, -5.0]; expected what an '
            'encoder can have, for joint_3a (near a joint angle of 5.6 deg the reading does '
            'not increase with the angle, expected one that is monotonic)'
        ),
    ),
    driver(
        'encoders.counter_mask',
        [0, 15, 0, 0],
        'bits of the counts',
        'a counter would be part of the angle',
        encoders__counter_byte=[0, 3, 0, 0],
        message=(
            "parameter 'encoders.counter_mask' is [0, 15, 0, 0]; expected bits that are not "
            'the counts, for joint_1b'
        ),
    ),
    driver(
        'encoders.status_mask',
        [0, 1, 0, 0],
        'bits of the counts',
        'an angle would be an error',
        message=(
            "parameter 'encoders.status_mask' is [0, 1, 0, 0]; expected bits that are not the "
            'counts, for joint_1b'
        ),
    ),
    driver(
        'encoders.status_mask',
        [0, 8, 0, 0],
        'bits of the counter',
        'every other frame would be an error',
        encoders__data_length=[4, 5, 4, 4],
        encoders__counter_byte=[0, 4, 0, 0],
        encoders__counter_mask=[0, 15, 0, 0],
        encoders__status_byte=[0, 4, 0, 0],
        message=(
            "parameter 'encoders.status_mask' is [0, 8, 0, 0]; expected bits that are not the "
            'counter, for joint_1b'
        ),
    ),
    driver(
        'encoders.status_good',
        [0, 1, 0, 0],
        'bits that `encoders.status_mask` has not',
        'no frame would be good',
        message=(
            "parameter 'encoders.status_good' is [0, 1, 0, 0]; expected bits of "
            'encoders.status_mask, for joint_1b'
        ),
    ),
    driver(
        'encoders.window',
        0.005,
        'more than 3 periods',
        'after a lost frame sets wait for the end of their cycle for as long',
        message=(
            "parameter 'encoders.window' is 0.005; expected 0, or from 1e-05 s to 3 periods, "
            '0.003 s at 1000 Hz: after a lost frame sets wait for the end of their cycle for '
            'as long'
        ),
    ),
    driver(
        'encoders.window',
        1e-6,
        'less than 10 us, but not 0',
        'no answer would be in time',
        message=(
            "parameter 'encoders.window' is 1e-06; expected 0, or from 1e-05 s to 3 periods, "
            '0.003 s at 1000 Hz: after a lost frame sets wait for the end of their cycle for '
            'as long'
        ),
    ),
)
