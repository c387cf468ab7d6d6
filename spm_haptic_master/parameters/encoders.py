# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the encoders, of the CAN bus and of its recordings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.axes import AXIS_SETTINGS, MEASURED_AXIS_SETTINGS
from spm_haptic_master.parameters.setting import (
    ANY_COUNT,
    CALIBRATION_SETTING,
    RATE_SETTING,
    SENSORS_SETTING,
    Setting,
    Values,
)


def _each(*definition: Any, **limits: Any) -> Setting:
    """
    Return a setting with a value for each sensor.

    Parameters
    ----------
    *definition, **limits
        Fields of `Setting`; the default, if there is one, has four values.

    """
    return replace(Setting(*definition, **limits), count=4, per_sensor=True)


# Scale of each encoder, real or simulated.
COUNTS_PER_TURN_SETTING = _each(
    'encoders.counts_per_turn', int, 'counts per turn', minimum=2, maximum=2**31
)

# Remedy where there is no calibration.
CALIBRATE = (
    'the zero counts of your rig, which nothing but a calibration knows: run `ros2 run '
    'spm_haptic_master calibrate --motion --params-file rig.yaml -o calibration.yaml`, then give '
    '`--params-file calibration.yaml`'
)

# Settings of the frames, named as the fields of EncoderLayout (`id`: can_id).
LAYOUT_SETTINGS = (
    _each(
        'encoders.id',
        int,
        'CAN identifier of the frame with the counts (CANopen: COB-ID of '
        'the TPDO, 0x180 or 0x280 + node id)',
        minimum=1,
        maximum=0x1FFFFFFF,
    ),
    _each('encoders.extended', bool, 'the identifier has 29 bits (otherwise 11)'),
    _each('encoders.data_length', int, 'length of that frame, bytes', minimum=1, maximum=8),
    _each(
        'encoders.byte_offset', int, 'first byte of the word with the counts', minimum=0, maximum=7
    ),
    _each('encoders.bit_length', int, 'length of that word, bits', minimum=1, maximum=64),
    _each('encoders.byte_order', str, 'byte order of that word', allowed=('little', 'big')),
    _each(
        'encoders.mask',
        int,
        'contiguous bits of that word that are the counts; 0: all',
        minimum=0,
        maximum=2**63 - 1,
    ),
    _each('encoders.signed', bool, "the counts are a two's complement number"),
    COUNTS_PER_TURN_SETTING,
    _each('encoders.direction', int, 'sign of counts against joint angle', allowed=(1, -1)),
    _each('encoders.zero_count', int, 'counts at joint angle 0', minimum=0, remedy=CALIBRATE),
    _each(
        'encoders.counter_byte',
        int,
        'byte of the frame with a rolling counter',
        minimum=0,
        maximum=7,
    ),
    _each(
        'encoders.counter_mask',
        int,
        'contiguous bits of that counter in its byte; 0: no counter',
        minimum=0,
        maximum=0xFF,
    ),
    _each('encoders.status_byte', int, 'byte of the frame with status bits', minimum=0, maximum=7),
    _each(
        'encoders.status_mask', int, 'status bits in that byte; 0: none', minimum=0, maximum=0xFF
    ),
    _each(
        'encoders.status_good',
        int,
        'value of the status bits without an error',
        minimum=0,
        maximum=0xFF,
    ),
)

# Settings of the harmonics of each encoder, of the first one and of all others.
FIRST_HARMONIC_SETTINGS = tuple(
    _each(
        f'encoders.harmonic_{part}_deg',
        float,
        f'{function} part of the first harmonic of '
        'the reading (reading = angle + cos part x cos(angle) + sin part x sin(angle)), deg',
        minimum=-10.0,
        maximum=10.0,
    )
    for part, function in (('cos', 'cosine'), ('sin', 'sine'))
)
TABLE_SETTINGS = tuple(
    Setting(
        f'encoders.table_deg.{joint}',
        float,
        'deviation of the reading beside its first '
        'harmonic, at n equally spaced joint angles from 0 on (n values are exact for orders '
        'below n / 2), deg; a single 0: none',
        minimum=-10.0,
        maximum=10.0,
        count=ANY_COUNT,
    )
    for joint in ALL_JOINT_NAMES
)
HARMONIC_SETTINGS = (*FIRST_HARMONIC_SETTINGS, *TABLE_SETTINGS)

VERIFIED_SETTING = _each(
    'encoders.direction_verified', bool, 'whether a calibration has verified the direction'
)
ACCEPT_SETTING = Setting(
    'encoders.accept_unverified_directions',
    bool,
    'publish angles although not every direction '
    'is verified, at WARN (otherwise the driver refuses to start)',
)

# Settings of the decoder, on a bus and for a recording.
DECODER_SETTINGS = (
    RATE_SETTING,
    SENSORS_SETTING,
    Setting(
        'can.protocol',
        str,
        'protocol of the encoders: canopen (CiA 301 with NMT, heartbeat '
        'and EMCY) or raw (frames with counts only)',
        allowed=('canopen', 'raw'),
    ),
    Setting(
        'can.heartbeat_timeout',
        float,
        'time without a heartbeat, after the first one, that is a fault, s',
        minimum=0.01,
        maximum=60.0,
    ),
    Setting(
        'can.emcy_stops',
        bool,
        'an encoder that reports an error (EMCY, error register), whose heartbeat is lost or that '
        'is not operational has no reading: no samples with four sensors, NaN with five or six; '
        'false: that is reported only',
    ),
    CALIBRATION_SETTING,
    *LAYOUT_SETTINGS,
    *HARMONIC_SETTINGS,
    VERIFIED_SETTING,
    ACCEPT_SETTING,
    *AXIS_SETTINGS,
    _each('encoders.node_id', int, 'CANopen node id', minimum=1, maximum=127),
    Setting(
        'encoders.sync_id',
        int,
        'identifier of SYNC; 0: no SYNC on the bus',
        minimum=0,
        maximum=0x7FF,
    ),
    Setting(
        'encoders.window',
        float,
        'with SYNC: longest time from it to an answer, and to a '
        'late one, s; without: longest time between the frames of a set, s (at most '
        'half a period); 0: three periods, at most 0.005 s',
        minimum=0.0,
        maximum=1.0,
    ),
)

CHANNEL_SETTING = Setting(
    'can.channel',
    str,
    "channel of that interface, such as 'can0'; in a replay the one whose frames are used, if "
    'several of the log have encoders',
)
BUS_SETTINGS = (
    Setting('can.interface', str, "python-can interface, 'socketcan' on a rig"),
    CHANNEL_SETTING,
    Setting(
        'can.bitrate',
        int,
        'bit rate of the bus, bit/s, to set it (if the interface can) and '
        'to check the bus load; 0: unknown',
        minimum=0,
        maximum=1000000,
    ),
)

CAN_SETTINGS = (
    *BUS_SETTINGS,
    Setting(
        'can.sync',
        str,
        'consume: another master produces SYNC; produce: this driver does, at `rate`',
        allowed=('consume', 'produce'),
    ),
    Setting(
        'can.timeout',
        float,
        'time without a set, or without an encoder, that is a fault, s',
        minimum=0.002,
        maximum=10.0,
    ),
    Setting('can.nmt_stop', bool, 'send NMT stop to the nodes when the driver ends'),
    *DECODER_SETTINGS,
)

MEASURED_SETTINGS = (
    *HARMONIC_SETTINGS,
    VERIFIED_SETTING,
    *(
        setting
        for setting in LAYOUT_SETTINGS
        if setting.name in ('encoders.direction', 'encoders.zero_count')
    ),
    *MEASURED_AXIS_SETTINGS,
)

# Formats of a log that python-can reads.
LOG_FORMATS = '.log, .asc, .blf, .csv, .trc, each also with .gz'
REPLAY_SETTINGS = (
    Setting('replay.path', str, f'log file ({LOG_FORMATS})', blank=True),
    Setting('replay.rate', float, 'pace against the recorded one', minimum=0.01, maximum=100.0),
    Setting('replay.loop', bool, 'restart at the end'),
    CHANNEL_SETTING,
    *DECODER_SETTINGS,
)

# Identifiers, which count up from encoder to encoder; all else of th3B and th3C is as of th3A.
COUNTING = ('encoders.id', 'encoders.node_id')


def sensors_of(given: Values) -> int:
    """
    Return the number of sensors among given values.

    Parameters
    ----------
    given : mapping
        Given values by name, not yet checked.

    Returns
    -------
    int
        4, 5 or 6; the default of the setting if none is given.

    Raises
    ------
    SettingError
        The number is not one of these.

    """
    sensors: int = SENSORS_SETTING.check(  # type: ignore[assignment]
        given.get(SENSORS_SETTING.name, SENSORS_SETTING.default)
    )
    return sensors


def for_sensors(settings: tuple[Setting, ...], sensors: int) -> tuple[Setting, ...]:
    """
    Return the settings of a number of sensors from those of the tables above.

    Parameters
    ----------
    settings : tuple of Setting
        Settings whose lists have a value for each of four sensors.
    sensors : int
        Number of sensors, 4 to 6.

    Returns
    -------
    tuple of Setting
        The settings with lists of that length, without tables of sensors that are not there.

    """
    absent = TABLE_SETTINGS[sensors:]
    return tuple(
        replace(setting, count=sensors) if setting.per_sensor else setting
        for setting in settings
        if setting not in absent
    )


def extended(defaults: Mapping[str, object], settings: tuple[Setting, ...]) -> dict[str, object]:
    """
    Return defaults of four encoders with those of th3B and th3C, as `settings` have them.

    Parameters
    ----------
    defaults : mapping
        Defaults by name, with lists for four encoders.
    settings : tuple of Setting
        Settings for the number of sensors, as of `for_sensors`.

    Returns
    -------
    dict
        The defaults, with each list repeated from its last value; identifiers count up.

    """
    found = dict(defaults)
    for setting in settings:
        values = found.get(setting.name)
        if setting.per_sensor and setting.count and isinstance(values, list):
            further = range(1, setting.count - len(values) + 1)
            found[setting.name] = values + [
                values[-1] + number if setting.name in COUNTING else values[-1]
                for number in further
            ]
    return found
