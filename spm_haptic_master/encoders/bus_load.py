# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a cycle costs on the bus, and whether the bit rate can carry it."""

from __future__ import annotations

from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.exceptions import SettingError

# ISO 11898-1: bits of a data frame without data, with 3 of interframe space; and those of them
# that are subject to bit stuffing (one bit more after at worst every four).
STANDARD_BITS, STANDARD_STUFFED = 47, 34
EXTENDED_BITS, EXTENDED_STUFFED = 67, 54
# Heartbeat, EMCY, NMT and SDO need some room too.
MAXIMUM_LOAD = 0.95


def frame_bits(data_length: int, extended: bool) -> int:
    """Return the bits that a classical data frame takes at worst."""
    bits, stuffed = (EXTENDED_BITS, EXTENDED_STUFFED) if extended \
        else (STANDARD_BITS, STANDARD_STUFFED)
    return bits + 8 * data_length + (stuffed + 8 * data_length - 1) // 4


def cycle_bits(layouts: tuple[EncoderLayout, ...], sync: bool) -> int:
    """Return the bits of four answers, and of SYNC where there is one."""
    return sum(frame_bits(layout.data_length, layout.extended) for layout in layouts) \
        + (frame_bits(0, False) if sync else 0)


def check_bus_load(layouts: tuple[EncoderLayout, ...], sync: bool, rate: float,
                   bitrate: int) -> None:
    """
    Refuse a rate that the bit rate cannot carry.

    Raises
    ------
    SettingError
        With the arithmetic, and the highest rate that would do.

    """
    bits = cycle_bits(layouts, sync)
    load = bits * rate / bitrate
    if load > MAXIMUM_LOAD:
        raise SettingError(
            'rate', rate,
            f'at most {MAXIMUM_LOAD * bitrate / bits:.0f} Hz at can.bitrate {bitrate}: a cycle of '
            f'{"SYNC and " if sync else ""}four answers has up to {bits} bits, and {bits} bits x '
            f'{rate:g} Hz / {bitrate} bit/s = {100.0 * load:.0f} % bus load, beyond '
            f'{100.0 * MAXIMUM_LOAD:.0f} %')
