# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the two encoders beside the orientation: insertion and gripper."""

from __future__ import annotations

from typing import Any

from spm_haptic_master.parameters.setting import Setting

# The axes: a slide along the handle's axis z (m), and the gripper (rad). Their names are those of
# the joints in their messages.
INSERTION = 'insertion'
GRIPPER = 'gripper'
AXES = (INSERTION, GRIPPER)


def _setting(name: str, default: Any, description: str, **limits: Any) -> Setting:
    """
    Return a setting of the kind of its default.

    Parameters
    ----------
    name : str
        Dotted name.
    default : bool, int, float or str
        Default, whose type is that of all values.
    description : str
        Meaning and unit in one line.
    **limits
        Further fields of `Setting`.

    Returns
    -------
    Setting
        A setting with a single value.

    """
    return Setting(name, type(default), description, default=default, **limits)


def _frame_settings(axis: str) -> tuple[Setting, ...]:
    """
    Return the settings of an axis's frame; named as those of one of the encoders.

    Parameters
    ----------
    axis : str
        INSERTION or GRIPPER: the first part of each name.

    Returns
    -------
    tuple of Setting
        Where the counts are in a CAN frame, and how they become a position.

    """
    return (
        *_identifier_settings(axis),
        _setting(f'{axis}.data_length', 4, 'length of that frame, bytes', minimum=1, maximum=8),
        _setting(
            f'{axis}.byte_offset',
            0,
            'first byte of the word with the counts',
            minimum=0,
            maximum=7,
        ),
        _setting(f'{axis}.bit_length', 32, 'length of that word, bits', minimum=1, maximum=64),
        _setting(
            f'{axis}.byte_order', 'little', 'byte order of that word', allowed=('little', 'big')
        ),
        _setting(
            f'{axis}.mask',
            0,
            'contiguous bits of that word that are the counts; 0: all',
            minimum=0,
            maximum=2**63 - 1,
        ),
        _setting(f'{axis}.signed', False, "the counts are a two's complement number"),
        *_status_settings(axis),
        _setting(f'{axis}.direction', 1, 'sign of counts against the position', allowed=(1, -1)),
        _setting(f'{axis}.zero_count', 0, 'counts at position 0', minimum=0, maximum=2**63 - 1),
    )


def _identifier_settings(axis: str) -> tuple[Setting, ...]:
    """Return the settings that name the frame of an axis's encoder, or its CANopen node."""
    return (
        _setting(
            f'{axis}.id',
            0,
            f'CAN identifier of the frame of the {axis} encoder; 0: there is none',
            minimum=0,
            maximum=0x1FFFFFFF,
        ),
        _setting(
            f'{axis}.node_id',
            0,
            f'CANopen node id of the {axis} encoder; 0: it is no node',
            minimum=0,
            maximum=127,
        ),
        _setting(f'{axis}.extended', False, 'the identifier has 29 bits (otherwise 11)'),
    )


def _status_settings(axis: str) -> tuple[Setting, ...]:
    """Return the settings of the status bits in the frame of an axis's encoder."""
    return (
        _setting(
            f'{axis}.status_byte', 0, 'byte of the frame with status bits', minimum=0, maximum=7
        ),
        _setting(
            f'{axis}.status_mask', 0, 'status bits in that byte; 0: none', minimum=0, maximum=0xFF
        ),
        _setting(
            f'{axis}.status_good',
            0,
            'value of the status bits without an error',
            minimum=0,
            maximum=0xFF,
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
