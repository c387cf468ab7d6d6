# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What settings make of the drives: what is refused, frames, and the load of the bus."""

from drive_rig import drive_values, make_test_plan
from encoder_frames import values
import pytest
from spm_haptic_master.drives.drive_factory import make_unchecked_drives
from spm_haptic_master.drives.plan import torque_frames
from spm_haptic_master.drives.shared_bus import check_shared_bus
from spm_haptic_master.exceptions import SettingError

MBIT = 1_000_000


def test_without_a_channel_there_are_no_drives():
    assert make_unchecked_drives(drive_values(drives__channel='')) is None


def test_nothing_is_opened_before_the_first_step():
    drives = make_unchecked_drives(drive_values())
    assert drives.motors == 3
    drives.close()


@pytest.mark.parametrize(
    ('given', 'name', 'words'),
    [
        ({'drives__rated_torque': [0.0]}, 'drives.rated_torque', 'rated torque, N m, above 0'),
        ({'drives__rated_torque': [0.1, 0.2]}, 'drives.rated_torque', 'one value, or 3'),
        ({'drives__node_id': [11, 11, 12]}, 'drives.node_id', 'different node ids'),
        ({'drives__node_id': [11, 12, 126]}, 'drives.node_id', 'drives.master_id'),
        ({'drives__node_id': [1, 2, 3, 4, 5]}, 'drives.node_id', 'at most 4 drives'),
        ({'drives__torque_limit': 16.384}, 'drives.torque_limit', 'it is 32768'),
        (
            {'drives__torque_limit': 0.001, 'drives__rated_torque': [2.0]},
            'drives.torque_limit',
            'it is 0',
        ),
        # Rounded to none, the drive's own limit would be left.
        ({'drives__speed_limit': 0.05}, 'drives.speed_limit', 'at least 0.10472 rad/s'),
        ({'drives__event_timer': 0.0105}, 'drives.event_timer', 'whole milliseconds'),
        ({'drives__event_timer': 0.002}, 'drives.event_timer', '3 samples at rate 1000 Hz'),
        ({'drives__status_timeout': 0.007}, 'drives.status_timeout', 'at least 0.008 s'),
        ({'drives__heartbeat_timeout': 0.039}, 'drives.heartbeat_timeout', 'at least 0.04 s'),
        (
            {'drives__verified_by_hand': '0x6040'},
            'drives.verified_by_hand',
            '0x6072:00, 0x1400:05',
        ),
        ({'drives__verified_by_hand': 'all'}, 'drives.verified_by_hand', 'objects out of'),
        (
            {'drives__status_by': 'encoder_sync', 'rate': 400.0},
            'drives.status_period',
            'whole periods of the SYNC of the encoders (2.5 ms)',
        ),
        ({'drives__interface': 'nothing'}, 'drives.interface', 'one of '),
        ({'drives__bitrate': 250_000}, 'drives.bitrate', '% bus load'),
    ],
)
def test_settings_that_contradict_each_other_are_refused(given, name, words):
    with pytest.raises(SettingError) as caught:
        make_unchecked_drives(drive_values(**given))
    assert caught.value.name == name
    assert words in str(caught.value)


def test_times_and_limits_may_be_as_short_as_they_say():
    make_unchecked_drives(
        drive_values(
            drives__event_timer=0.003,
            drives__status_timeout=0.008,
            drives__heartbeat_timeout=0.04,
            drives__torque_limit=16.3835,
        )
    )
    make_unchecked_drives(drive_values(drives__torque_limit=0.001, drives__rated_torque=[1.0]))


def test_a_speed_limit_is_in_turns_of_the_motor():
    assert make_test_plan(drives__speed_limit=0.11).drives[0].speed_limit == 1
    plan = make_test_plan(drives__speed_limit=10.0, drives__gear=[2.0])
    assert plan.drives[0].speed_limit == 191
    assert make_test_plan().drives[0].speed_limit == 0


def test_torques_are_per_mille_of_the_rated_torque_within_the_cap():
    plan = make_test_plan(
        drives__rated_torque=[0.1],
        drives__gear=[4.0],
        drives__direction=[-1],
        drives__torque_limit=0.3,
    )
    drive = plan.drives[0]
    assert drive.per_mille(0.2) == -500
    assert [drive.per_mille(torque) for torque in (9.0, -9.0)] == [-750, 750]


def test_the_frames_of_a_sample_are_laid_out_as_documented():
    plan = make_test_plan()
    assert torque_frames(plan, [0x0F, 0x06, 0x00], [1, -2, 1000], True) == [
        (0x20B, bytes.fromhex('0f000100')),
        (0x20C, bytes.fromhex('0600feff')),
        (0x20D, bytes.fromhex('0000e803')),
    ]
    plan = make_test_plan(drives__combined=True)
    assert torque_frames(plan, [0x0F, 0x06, 0x00], [1, -2, 1000], False) == [
        (0x30B, bytes.fromhex('0100feffe803'))
    ]
    assert torque_frames(plan, [0x0F, 0x06, 0x00], [1, -2, 1000], True)[1:] == [
        (0x20B, b'\x0f\0'),
        (0x20C, b'\x06\0'),
        (0x20D, b'\0\0'),
    ]


def check(encoders=(), **drives):
    """Check drives on the bus of the encoders."""
    check_shared_bus(
        drive_values(
            drives__interface='virtual',
            drives__channel='one',
            **drives,
        ),
        values(
            can__interface='virtual',
            can__channel='one',
            **{'can__bitrate': MBIT, **dict(encoders)},
        ),
    )


def test_drives_fit_on_the_bus_of_the_encoders_by_one_frame_and_at_an_unknown_bit_rate():
    check(drives__combined=True)
    check({'can__bitrate': 0})
    check_shared_bus(
        drive_values(drives__channel='two', drives__bitrate=MBIT),
        values(
            can__interface='virtual',
            can__channel='one',
            can__bitrate=MBIT,
        ),
    )


@pytest.mark.parametrize(
    ('status_by', 'encoders', 'name', 'words'),
    [
        ('sync', {}, 'drives.status_by', "'encoder_sync' on a bus that has SYNC already"),
        ('encoder_sync', {'encoders__sync_id': 0x70}, 'encoders.sync_id', 'know (0x80)'),
    ],
)
def test_one_bus_has_one_sync(status_by, encoders, name, words):
    check(drives__combined=True, drives__status_by='encoder_sync')
    with pytest.raises(SettingError) as caught:
        check(encoders, drives__combined=True, drives__status_by=status_by)
    assert caught.value.name == name
    assert words in str(caught.value)


def test_the_sync_of_the_encoders_is_on_their_bus_alone():
    with pytest.raises(SettingError, match='drives on the bus of the encoders'):
        check_shared_bus(
            drive_values(drives__channel='two', drives__status_by='encoder_sync'),
            values(can__interface='virtual', can__channel='one'),
        )


# Worst-case bits by the standard: a data frame of n bytes has 47 + 8 n, and a stuff bit for every
# four of 34 + 8 n - 1. SYNC and encoders: 55 + 4 * 95.
@pytest.mark.parametrize(
    ('given', 'name', 'words'),
    [
        (
            {},
            'drives.bitrate',
            "parameter 'drives.bitrate' is 1000000; expected a second bus (drives.channel) or one "
            'frame with all torques (drives.combined) or a lower rate: SYNC and encoders '
            '435 bits x '
            '1000 Hz + torque 285 bits x 1000 Hz + status 315 bits x 250 Hz + heartbeats '
            '260 bits x '
            '50 Hz = 81 % bus load, beyond 70 %',
        ),
        (
            {'drives__combined': True, 'drives__bitrate': 500_000},
            'drives.bitrate',
            'expected a second bus (drives.channel) or a lower rate: SYNC and encoders 435 bits x '
            '1000 Hz + torque 115 bits x 1000 Hz + status 315 bits x 250 Hz + heartbeats '
            '260 bits x '
            '50 Hz + controlwords 225 bits x 50 Hz = 131 % bus load',
        ),
        (
            {'drives__combined': True, 'encoders': {'insertion__id': 9}},
            'drives.bitrate',
            'SYNC and encoders 435 bits x 1000 Hz + insertion 95 bits x 1000 Hz + torque',
        ),
        (
            {'drives__combined': True, 'drives__node_id': [4, 5, 6]},
            'drives.node_id',
            '4 is in encoders.node_id',
        ),
        (
            {'drives__combined': True, 'drives__master_id': 2},
            'drives.node_id',
            '2 is in encoders.node_id',
        ),
        (
            {
                'drives__combined': True,
                'encoders': {'encoders__id': [0x18C, 2, 3, 4], 'can__protocol': 'raw'},
            },
            'encoders.id',
            '0x18C of joint_1a',
        ),
        # The data of an encoder would be a torque, an SDO request, a heartbeat of this master.
        *(
            (
                {
                    'drives__combined': True,
                    'encoders': {
                        'encoders__id': [2, 3, identifier, 4],
                        'encoders__sync_id': 0,
                        'can__protocol': 'raw',
                    },
                },
                'encoders.id',
                f'0x{identifier:X} of joint_1c',
            )
            for identifier in (0x08B, 0x30C, 0x40D, 0x50B, 0x58B, 0x60C, 0x70D, 0x77E)
        ),
        (
            {'drives__combined': True, 'encoders': {'insertion__id': 0x60C}},
            'insertion.id',
            'nor this master (0x60C)',
        ),
        (
            {'drives__combined': True, 'encoders': {'gripper__id': 9, 'gripper__node_id': 12}},
            'drives.node_id',
            '12 is in gripper.node_id',
        ),
        # Without SYNC of the drives another device may have its identifier.
        (
            {
                'drives__combined': True,
                'drives__status_by': 'sync',
                'encoders': {
                    'encoders__id': [1, 2, 0x80, 4],
                    'encoders__sync_id': 0,
                    'can__protocol': 'raw',
                },
            },
            'encoders.id',
            '0x80 of joint_1c',
        ),
    ],
)
def test_drives_that_do_not_fit_on_the_bus_of_the_encoders_are_refused(given, name, words):
    with pytest.raises(SettingError) as caught:
        check(**given)
    assert caught.value.name == name
    assert words in str(caught.value)
