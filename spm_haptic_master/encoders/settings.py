# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the encoders on the bus, of the bus itself and of a recording of it."""

from __future__ import annotations

from spm_haptic_master.encoders import canopen
from spm_haptic_master.settings import Setting

COUNTS_PER_TURN_SETTING = Setting(
    'encoders.counts_per_turn', int, 'counts of one turn', minimum=2, maximum=2**31, count=4)

LAYOUT_SETTINGS = (
    Setting('encoders.id', int, 'CAN identifier of the frame that carries the counts '
            '(CANopen: COB-ID of the TPDO, 0x180 or 0x280 + node id)',
            minimum=1, maximum=0x1FFFFFFF, count=4),
    Setting('encoders.extended', bool, 'the identifier has 29 bits (else 11)', count=4),
    Setting('encoders.data_length', int, 'bytes of that frame', minimum=1, maximum=8, count=4),
    Setting('encoders.byte_offset', int, 'byte where the word with the counts begins',
            minimum=0, maximum=7, count=4),
    Setting('encoders.bit_length', int, 'bits of that word', minimum=1, maximum=64, count=4),
    Setting('encoders.byte_order', str, 'byte order of that word',
            allowed=('little', 'big'), count=4),
    Setting('encoders.mask', int, 'bits of that word that are the counts, in one piece; '
            '0: all of them', minimum=0, maximum=2**63 - 1, count=4),
    Setting('encoders.signed', bool, "the counts are a two's complement number", count=4),
    COUNTS_PER_TURN_SETTING,
    Setting('encoders.direction', int, 'sign of counts against joint angle',
            allowed=(1, -1), count=4),
    Setting('encoders.zero_count', int, 'counts at joint angle 0', minimum=0, count=4),
    Setting('encoders.counter_byte', int, 'byte of the frame with a rolling counter',
            minimum=0, maximum=7, count=4),
    Setting('encoders.counter_mask', int, 'bits of that counter in its byte; 0: there is none',
            minimum=0, maximum=0xFF, count=4),
    Setting('encoders.status_byte', int, 'byte of the frame with status bits',
            minimum=0, maximum=7, count=4),
    Setting('encoders.status_mask', int, 'status bits in that byte; 0: there are none',
            minimum=0, maximum=0xFF, count=4),
    Setting('encoders.status_good', int, 'what the status bits say when all is well',
            minimum=0, maximum=0xFF, count=4),
)

RATE_SETTING = Setting('rate', float, 'rate of the sets of joint angles, Hz',
                       default=1000.0, minimum=1.0, maximum=10000.0)

DECODER_SETTINGS = (
    RATE_SETTING,
    Setting('can.protocol', str, 'what the encoders speak: canopen (CiA 301: NMT, heartbeat and '
            'EMCY too) or raw (their frames only)', allowed=('canopen', 'raw')),
    Setting('can.heartbeat_timeout', float, 's without a heartbeat, once there was one, after '
            'which a node counts as lost', minimum=0.01, maximum=60.0),
    Setting('can.emcy_stops', bool, 'no joint sample while an encoder reports an emergency '
            '(else it is reported, and samples go on)'),
    *LAYOUT_SETTINGS,
    Setting('encoders.node_id', int, 'CANopen node id', minimum=1,
            maximum=canopen.NODE_ID_MAXIMUM, count=4),
    Setting('encoders.sync_id', int, 'identifier of SYNC; 0: the bus has no SYNC',
            minimum=0, maximum=0x7FF),
    Setting('encoders.window', float, 's; with SYNC how long after it an answer counts, and a '
            'missing one may still come; '
            'without it how far apart the four frames of a set may be (at most half a period)',
            minimum=1e-5, maximum=1.0),
)

BUS_SETTINGS = (
    Setting('can.interface', str, "python-can interface, 'socketcan' on a rig"),
    Setting('can.channel', str, "its channel, 'can0' for instance"),
    Setting('can.bitrate', int, 'bit/s of the bus; set where the interface does that, and used to '
            'check the bus load; 0: unknown', minimum=0, maximum=1000000),
)

CAN_SETTINGS = (
    *BUS_SETTINGS,
    Setting('can.sync', str, 'consume: another master makes SYNC; produce: this driver does, '
            'at `rate`', allowed=('consume', 'produce')),
    Setting('can.timeout', float, 's without a set, or without an encoder, after which that '
            'is a fault', minimum=0.002, maximum=10.0),
    Setting('can.nmt_stop', bool, 'NMT stop to the nodes when the driver ends'),
    *DECODER_SETTINGS,
)

REPLAY_SETTINGS = (
    Setting('replay.path', str,
            'log file (.log, .asc, .csv, .trc; also .gz; and .blf)'),
    Setting('replay.rate', float, 'pace; 1.0 is as recorded', minimum=0.01, maximum=100.0),
    Setting('replay.loop', bool, 'start again at the end'),
    *DECODER_SETTINGS,
)
