# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The decoder of the encoders' frames; their settings, checked against each other and the bus.

What one setting alone may be is checked with its declaration, in `parameters`.
"""

from __future__ import annotations

from math import radians
from typing import Any

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes
from spm_haptic_master.encoders.encoder_layout import EncoderLayout, lowest_bit
from spm_haptic_master.encoders.frame_decoder import FrameDecoder
from spm_haptic_master.encoders.harmonics import Harmonics
from spm_haptic_master.encoders.single_axis import make_axes, SingleAxis
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, NUMBER_WORDS
from spm_haptic_master.parameters import encoders
from spm_haptic_master.parameters.setting import Values

# Largest identifier of 11 bits.
STANDARD_MAXIMUM = 0x7FF
# Longest window of an answer (periods): after a lost frame, sets wait for as long for the end of
# their cycle.
WINDOW_PERIODS = 3
# Longest window of an answer where none is set (s): at a low rate an answer later than this is
# a symptom, and not a slow bus.
WINDOW_DEFAULT = 0.005
# Shortest window (s): no frames of a set fit into less at 1 Mbit/s.
WINDOW_MINIMUM = 1e-5
# Relative rounding error of a rate or window written with six digits (unit 1).
ROUNDING = 1e-5
# Length of a data frame without data (bits), with an identifier of 11 and of 29 bits and with 3
# bits of interframe space; and the part of it that is never stuffed (ISO 11898-1).
STANDARD_BITS = 47
EXTENDED_BITS = 67
UNSTUFFED_BITS = 13
# Largest share of the bus for SYNC and answers (unit 1): heartbeat, EMCY, NMT and SDO need the
# rest.
MAXIMUM_LOAD = 0.95


def make_decoder(values: Values, drives: tuple[int, ...] = ()) -> FrameDecoder:
    """
    Return the decoder of the encoders.

    Parameters
    ----------
    values : Values
        Checked settings of the encoders and the bus, and `rate`.
    drives : tuple of int
        Node ids of the drives on the same bus.

    Raises
    ------
    SettingError
        Settings contradict each other.

    """
    layouts = make_layouts(values)
    joints = tuple(layout.joint for layout in layouts)
    sync_id = values['encoders.sync_id'] or None
    period = 1.0 / values['rate']
    window = _window(values)
    if sync_id is None:
        # Frames further apart may be from two cycles, which nothing distinguishes.
        window = min(window, 0.5 * period)
    network = None
    axes = make_axes(values, values['can.heartbeat_timeout'])
    further = tuple(axis.node for axis in axes if axis.node is not None)
    if values['can.protocol'] == 'canopen':
        node_ids = values['encoders.node_id']
        if len(set(node_ids)) < len(node_ids):
            raise SettingError(
                name='encoders.node_id',
                value=list(node_ids),
                expected=f'{NUMBER_WORDS[len(joints)]} different node ids',
            )
        network = CanopenNodes(
            joints=joints,
            node_ids=node_ids,
            heartbeat_timeout=values['can.heartbeat_timeout'],
            drives=drives,
            further=further,
        )
    _check_axes(axes, layouts, sync_id, values)
    _check_identifiers(layouts, sync_id, network is not None)
    return FrameDecoder(
        layouts=layouts,
        sync_id=sync_id,
        period=period,
        window=window,
        network=network,
        emcy_stops=values['can.emcy_stops'],
        axes=axes,
    )


def _check_axes(
    axes: tuple[SingleAxis, ...],
    layouts: tuple[EncoderLayout, ...],
    sync_id: int | None,
    values: Values,
) -> None:
    """
    Refuse an axis with the identifier or node id of another encoder.

    Parameters
    ----------
    axes : tuple of SingleAxis
        Insertion and gripper, if they have encoders.
    layouts : tuple of EncoderLayout
        Encoders of the joints.
    sync_id : int or None
        Identifier of SYNC; None without SYNC.
    values : Values
        Checked settings.

    Raises
    ------
    SettingError
        A value is used twice, or the layout of an axis contradicts itself.

    """
    taken: dict[int | None, str] = {layout.can_id: layout.joint for layout in layouts}
    taken[sync_id] = 'SYNC'
    is_canopen = values['can.protocol'] == 'canopen'
    joints = [layout.joint for layout in layouts]
    if is_canopen:
        nodes = dict(zip(values['encoders.node_id'], joints, strict=True))
    else:
        nodes = {}
    for axis in axes:
        _check_layout(axis, values)
        _take(taken, axis.layout.can_id, f'{axis.name}.id', 'an identifier')
        if is_canopen:
            _check_unreserved(axis.layout, f'{axis.name}.id', axis.layout.can_id)
        if axis.node is not None:
            _take(nodes, axis.node.node_id, f'{axis.name}.node_id', 'a node id')


def _check_layout(axis: SingleAxis, values: Values) -> None:
    """Raise SettingError where the layout of an axis contradicts itself."""
    if not axis.layout.extended and axis.layout.can_id > STANDARD_MAXIMUM:
        raise SettingError(
            name=f'{axis.name}.id',
            value=axis.layout.can_id,
            expected=f'an 11-bit identifier (0x001 to 0x7FF), or {axis.name}.extended true',
        )
    for name, fits, expected in _requirements(axis.layout):
        setting = name.replace('encoders.', f'{axis.name}.')
        if not fits and setting in values:
            raise SettingError(
                name=setting,
                value=values[setting],
                expected=expected,
            )


def _take(
    taken: dict[Any, str],
    value: int,
    setting: str,
    what: str,
) -> None:
    """Note the encoder that has a value; SettingError if another one has it."""
    if value in taken:
        raise SettingError(
            name=setting,
            value=value,
            expected=f'{what} that {taken[value]} does not have',
        )
    taken[value] = setting.partition('.')[0]


def _window(values: Values) -> float:
    """Return the longest time from SYNC to an answer, s; SettingError if it is too long."""
    period: float = 1.0 / values['rate']
    window: float = values['encoders.window']
    longest = WINDOW_PERIODS * period
    if not window:
        return min(longest, WINDOW_DEFAULT)
    if not WINDOW_MINIMUM <= window <= longest * (1.0 + ROUNDING):
        raise SettingError(
            name='encoders.window',
            value=window,
            expected=(
                f'0, or from {WINDOW_MINIMUM:g} s to {WINDOW_PERIODS} periods, {longest:g} s at '
                f'{values["rate"]:g} Hz: after a lost frame sets wait for the end of their cycle '
                'for as long'
            ),
        )
    return window


def _check_identifiers(
    layouts: tuple[EncoderLayout, ...],
    sync_id: int | None,
    canopen_nodes: bool,
) -> None:
    """Raise SettingError if the identifier of SYNC or of an encoder's frame has another use."""
    taken = {layout.can_id: layout.joint for layout in layouts if not layout.extended}
    if sync_id in taken:
        raise SettingError(
            name='encoders.sync_id',
            value=sync_id,
            expected=f'an identifier that no encoder has ({taken[sync_id]} has it)',
        )
    if canopen_nodes:
        _check_reserved(layouts, sync_id)


def _check_reserved(layouts: tuple[EncoderLayout, ...], sync_id: int | None) -> None:
    """Raise SettingError if an identifier of an encoder, or SYNC, has another use in CANopen."""
    for layout in layouts:
        _check_unreserved(layout, 'encoders.id', [each.can_id for each in layouts])
    if sync_id not in (None, canopen.SYNC_ID) and (use := canopen.reserved_for(sync_id or 0)):
        raise SettingError(
            name='encoders.sync_id',
            value=sync_id,
            expected=f'an identifier that CANopen has no other use for (0x{sync_id:X}: {use}), or '
            'can.protocol raw',
        )


def _check_unreserved(
    layout: EncoderLayout,
    setting: str,
    given: object,
) -> None:
    """Raise SettingError for the setting of an identifier if it has another use in CANopen."""
    use = None if layout.extended else canopen.reserved_for(layout.can_id)
    if use:
        raise SettingError(
            name=setting,
            value=given,
            expected=(
                f'for {layout.joint} an identifier that CANopen has no other use for '
                f'(0x{layout.can_id:X}: {use}), or can.protocol raw'
            ),
        )


def make_layouts(values: Values) -> tuple[EncoderLayout, ...]:
    """
    Return the layouts of the encoders, in the order of ALL_JOINT_NAMES.

    Parameters
    ----------
    values : Values
        Checked settings of the encoders.

    Raises
    ------
    SettingError
        A layout contradicts itself, or two have one identifier.

    """
    joints = ALL_JOINT_NAMES[: values['sensors']]
    fields = {
        setting.name.removeprefix('encoders.'): values[setting.name]
        for setting in encoders.LAYOUT_SETTINGS
    }
    identifiers = fields.pop('id')
    layouts = tuple(
        EncoderLayout(
            joint=joint,
            can_id=identifiers[index],
            harmonics=harmonics,
            **{name: column[index] for name, column in fields.items()},
        )
        for index, (joint, harmonics) in enumerate(
            zip(joints, make_harmonics(values), strict=True)
        )
    )
    seen: dict[int, str] = {}
    for layout in layouts:
        if not layout.extended and layout.can_id > STANDARD_MAXIMUM:
            raise SettingError(
                name='encoders.id',
                value=list(values['encoders.id']),
                expected=f'an 11-bit identifier for {layout.joint} (0x001 to 0x7FF), '
                'or encoders.extended true for it',
            )
        if layout.can_id in seen:
            raise SettingError(
                name='encoders.id',
                value=list(values['encoders.id']),
                expected=(
                    f'{NUMBER_WORDS[len(joints)]} different identifiers; {seen[layout.can_id]} '
                    f'and {layout.joint} both have 0x{layout.can_id:X}'
                ),
            )
        seen[layout.can_id] = layout.joint
        for name, fits, expected in _requirements(layout):
            if not fits:
                raise SettingError(
                    name=name,
                    value=list(values[name]),
                    expected=f'{expected}, for {layout.joint}',
                )
    return layouts


def make_harmonics(values: Values) -> tuple[Harmonics | None, ...]:
    """
    Return the harmonics of the encoders, in the order of ALL_JOINT_NAMES.

    Parameters
    ----------
    values : Values
        Checked settings of the encoders; their harmonics are in deg.

    Returns
    -------
    tuple of N Harmonics or None
        None for an encoder without any.

    Raises
    ------
    SettingError
        A table has a wrong length, or a reading would not increase with its angle.

    """
    first_settings = encoders.FIRST_HARMONIC_SETTINGS
    first = zip(*(values[setting.name] for setting in first_settings), strict=True)
    tables = encoders.TABLE_SETTINGS[: values['sensors']]
    found: list[Harmonics | None] = []
    for index, ((cosine, sine), setting) in enumerate(zip(first, tables, strict=True)):
        if values[setting.name] == (0.0,):
            table = ()
        else:
            table = values[setting.name]
        if any(table):
            name = setting.name
        else:
            name = first_settings[0 if cosine else 1].name
        if not (cosine or sine or table):
            found.append(None)
            continue
        try:
            found.append(
                Harmonics(
                    cosine=radians(cosine),
                    sine=radians(sine),
                    table=tuple(map(radians, table)),
                )
            )
        except InputError as error:
            raise SettingError(
                name=name,
                value=list(values[name]),
                expected=f'what an encoder can have, for {ALL_JOINT_NAMES[index]} ({error})',
            ) from error
    return tuple(found)


def _requirements(layout: EncoderLayout) -> tuple[tuple[str, bool, str], ...]:
    """Return the requirements of one layout: setting, whether it is met, what is expected."""
    position = layout.position_mask
    used = position.bit_count()
    # Whether mask or bit length select the bits of a turn, not just a word.
    chosen = position != (1 << layout.bit_length) - 1 or layout.bit_length % 8 != 0
    # Bits of the frame that hold counts, counter and status; bit 8 n is the lowest of byte n.
    word = (position & (1 << 8 * layout.byte_length) - 1).to_bytes(
        layout.byte_length, layout.byte_order
    )
    counts = int.from_bytes(word, 'little') << 8 * layout.byte_offset
    length = f'within the {layout.data_length} bytes of encoders.data_length'
    return (
        (
            'encoders.byte_offset',
            layout.byte_offset + layout.byte_length <= layout.data_length,
            f'a word of {layout.bit_length} bits that ends {length}',
        ),
        (
            'encoders.mask',
            position < 1 << layout.bit_length,
            f'bits within the {layout.bit_length} of encoders.bit_length',
        ),
        ('encoders.mask', _contiguous(position), 'contiguous bits'),
        (
            'encoders.counts_per_turn',
            layout.counts_per_turn <= 1 << used,
            f'what {used} bits can hold',
        ),
        (
            'encoders.counts_per_turn',
            not chosen or 2 * layout.counts_per_turn > 1 << used,
            f'more than {1 << used - 1}, as encoders.mask or encoders.bit_length selects {used} '
            'bits',
        ),
        (
            'encoders.zero_count',
            layout.zero_count < layout.counts_per_turn,
            f'counts below the {layout.counts_per_turn} of encoders.counts_per_turn',
        ),
        *_bit_requirements(layout, counts, length),
    )


def _bit_requirements(
    layout: EncoderLayout,
    counts: int,
    length: str,
) -> tuple[tuple[str, bool, str], ...]:
    """
    Return the requirements of rolling counter and status bits.

    `counts` are the bits of the frame with the counts; `length` describes the frame's end.
    """
    counter = layout.counter_mask << 8 * layout.counter_byte
    status = layout.status_mask << 8 * layout.status_byte
    return (
        (
            'encoders.counter_byte',
            not layout.counter_mask or layout.counter_byte < layout.data_length,
            f'a byte {length}',
        ),
        ('encoders.counter_mask', _contiguous(layout.counter_mask), 'contiguous bits'),
        ('encoders.counter_mask', not counter & counts, 'bits that are not the counts'),
        ('encoders.status_mask', not status & counts, 'bits that are not the counts'),
        ('encoders.status_mask', not status & counter, 'bits that are not the counter'),
        (
            'encoders.status_byte',
            not layout.status_mask or layout.status_byte < layout.data_length,
            f'a byte {length}',
        ),
        (
            'encoders.status_good',
            layout.status_good & ~layout.status_mask == 0,
            'bits of encoders.status_mask',
        ),
    )


def _contiguous(mask: int) -> bool:
    """Return whether the bits of a mask are contiguous; a mask of 0 is."""
    return not mask or mask.bit_count() == mask.bit_length() - lowest_bit(mask)


def unverified_joints(values: Values) -> tuple[str, ...]:
    """
    Return the joints whose direction no calibration verified.

    The angles cannot show a wrong direction of joint_3a: on the centre line the mirrored angle
    fits another assembly mode exactly.

    Parameters
    ----------
    values : Values
        Checked settings.

    Returns
    -------
    tuple of str
        Names of the joints; empty where no counts are decoded.

    Raises
    ------
    SettingError
        There is such a joint, and the settings do not accept that.

    """
    verified = values.get(encoders.VERIFIED_SETTING.name)
    if verified is None:
        return ()
    joints = tuple(
        joint for joint, known in zip(ALL_JOINT_NAMES, verified, strict=False) if not known
    )
    if joints and not values[encoders.ACCEPT_SETTING.name]:
        raise SettingError(
            name=encoders.VERIFIED_SETTING.name,
            value=list(verified),
            expected=(
                f'true for each: the direction of {", ".join(joints)} is not verified; calibrate '
                'at two poses (calibrate --pose ... --pose ...) and give the file that it writes, '
                f'or set {encoders.ACCEPT_SETTING.name} to true to run at WARN'
            ),
        )
    return joints


def frame_bits(data_length: int, extended: bool) -> int:
    """
    Return the worst-case length of a classical data frame (ISO 11898-1).

    Parameters
    ----------
    data_length : int
        Length of the data, bytes.
    extended : bool
        Whether the identifier has 29 bits.

    Returns
    -------
    int
        Bits, with one stuff bit after each four and with the interframe space.

    """
    bits = 8 * data_length + (EXTENDED_BITS if extended else STANDARD_BITS)
    return bits + (bits - UNSTUFFED_BITS - 1) // 4


def cycle_bits(layouts: tuple[EncoderLayout, ...], sync: bool) -> int:
    """
    Return the worst-case length of a cycle.

    Parameters
    ----------
    layouts : tuple of EncoderLayout
        Encoders, each of which sends one frame in a cycle.
    sync : bool
        Whether SYNC belongs to it.

    Returns
    -------
    int
        Bits.

    """
    return sum(frame_bits(layout.data_length, layout.extended) for layout in layouts) + (
        frame_bits(0, False) if sync else 0
    )


def check_bus_load(
    layouts: tuple[EncoderLayout, ...],
    sync: bool,
    rate: float,
    bitrate: int,
) -> None:
    """
    Refuse a rate that the bus cannot carry.

    Parameters
    ----------
    layouts : tuple of EncoderLayout
        Encoders, each of which sends one frame in a cycle.
    sync : bool
        Whether SYNC belongs to a cycle.
    rate : float
        Rate of the cycles, Hz.
    bitrate : int
        Bit rate, bit/s.

    Raises
    ------
    SettingError
        The load is beyond MAXIMUM_LOAD; the text has the highest rate and the arithmetic.

    """
    bits = cycle_bits(layouts, sync)
    load = bits * rate / bitrate
    if load > MAXIMUM_LOAD:
        highest = MAXIMUM_LOAD * bitrate / bits
        frames = f'{NUMBER_WORDS.get(len(layouts), len(layouts))} answers'
        if sync:
            frames = f'SYNC and {frames}'
        raise SettingError(
            name='rate',
            value=rate,
            expected=(
                f'at most {highest:.0f} Hz at can.bitrate {bitrate}: a cycle of {frames} has up '
                f'to {bits} bits, and {bits} bits x {rate:g} Hz / {bitrate} bit/s = '
                f'{100.0 * load:.0f} % bus load, beyond {100.0 * MAXIMUM_LOAD:.0f} %'
            ),
        )
