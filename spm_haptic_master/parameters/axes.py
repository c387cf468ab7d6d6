# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the two encoders beside the orientation: insertion and gripper."""

from __future__ import annotations

from spm_haptic_master.parameters.setting import Setting

# The axes: a slide along the handle's axis z (m), and the gripper (rad). Their names are those of
# the joints in their messages.
INSERTION, GRIPPER = 'insertion', 'gripper'
AXES = (INSERTION, GRIPPER)


def _frame_settings(axis: str) -> tuple[Setting, ...]:
    """Return the settings of an axis's frame; named as those of one of the encoders."""
    return (
        Setting(
            f'{axis}.id',
            int,
            f'CAN identifier of the frame of the {axis} encoder; 0: there is none',
            default=0,
            minimum=0,
            maximum=0x1FFFFFFF,
        ),
        Setting(
            f'{axis}.node_id',
            int,
            f'CANopen node id of the {axis} encoder; 0: it is no node',
            default=0,
            minimum=0,
            maximum=127,
        ),
        Setting(
            f'{axis}.extended',
            bool,
            'the identifier has 29 bits (otherwise 11)',
            default=False,
        ),
        Setting(
            f'{axis}.data_length',
            int,
            'length of that frame, bytes',
            default=4,
            minimum=1,
            maximum=8,
        ),
        Setting(
            f'{axis}.byte_offset',
            int,
            'first byte of the word with the counts',
            default=0,
            minimum=0,
            maximum=7,
        ),
        Setting(
            f'{axis}.bit_length',
            int,
            'length of that word, bits',
            default=32,
            minimum=1,
            maximum=64,
        ),
        Setting(
            f'{axis}.byte_order',
            str,
            'byte order of that word',
            default='little',
            allowed=('little', 'big'),
        ),
        Setting(
            f'{axis}.mask',
            int,
            'contiguous bits of that word that are the counts; 0: all',
            default=0,
            minimum=0,
            maximum=2**63 - 1,
        ),
        Setting(f'{axis}.signed', bool, "the counts are a two's complement number", default=False),
        Setting(
            f'{axis}.status_byte',
            int,
            'byte of the frame with status bits',
            default=0,
            minimum=0,
            maximum=7,
        ),
        Setting(
            f'{axis}.status_mask',
            int,
            'status bits in that byte; 0: none',
            default=0,
            minimum=0,
            maximum=0xFF,
        ),
        Setting(
            f'{axis}.status_good',
            int,
            'value of the status bits without an error',
            default=0,
            minimum=0,
            maximum=0xFF,
        ),
        Setting(
            f'{axis}.direction',
            int,
            'sign of counts against the position',
            default=1,
            allowed=(1, -1),
        ),
        Setting(
            f'{axis}.zero_count',
            int,
            'counts at position 0',
            default=0,
            minimum=0,
            maximum=2**63 - 1,
        ),
    )


GRIPPER_RANGE_SETTING = Setting(
    'gripper.range_deg',
    float,
    'angles of the gripper at the ends -1 and 1 of the axis of gripper/joy, and least and '
    'greatest angle of its encoder, deg',
    default=(0.0, 60.0),
    minimum=-180.0,
    maximum=180.0,
    count=2,
)
AXIS_SETTINGS = (
    *_frame_settings(INSERTION),
    Setting(
        'insertion.counts_per_metre',
        float,
        'counts of the insertion encoder per metre',
        default=1e6,
        minimum=100.0,
        maximum=1e12,
    ),
    Setting(
        'insertion.range',
        float,
        'least and greatest insertion, m; 2 % beyond it there is no reading',
        default=(0.0, 0.2),
        minimum=-2.0,
        maximum=2.0,
        count=2,
    ),
    Setting(
        'insertion.speed_limit',
        float,
        'speed of the insertion beyond which there is no reading, m/s',
        default=1.0,
        minimum=0.01,
        maximum=100.0,
    ),
    *_frame_settings(GRIPPER),
    Setting(
        'gripper.counts_per_turn',
        int,
        'counts of the gripper encoder per turn',
        default=16384,
        minimum=2,
        maximum=2**31,
    ),
    GRIPPER_RANGE_SETTING,
)
# What a calibration measures of them.
MEASURED_AXIS_SETTINGS = tuple(
    setting
    for setting in AXIS_SETTINGS
    if setting.name.endswith(('.direction', '.zero_count', '.counts_per_metre'))
    or setting.name in ('insertion.range', GRIPPER_RANGE_SETTING.name)
)
