# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Worst-case bus load of a cycle, checked against the bit rate."""

from __future__ import annotations

from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.joints import NUMBER_WORDS

# Length of a data frame with an 11-bit identifier and no data (bits), with 3 bits of interframe
# space, and the part of it subject to bit stuffing: at worst one more bit for every four
# (ISO 11898-1).
STANDARD_BITS, STANDARD_STUFFED = 47, 34
# The same of a frame with a 29-bit identifier (bits).
EXTENDED_BITS, EXTENDED_STUFFED = 67, 54
# Largest share of the bus for SYNC and answers (unit 1): heartbeat, EMCY, NMT and SDO need the
# rest.
MAXIMUM_LOAD = 0.95


def frame_bits(data_length: int, extended: bool) -> int:
    """Return the worst-case length of a classical data frame, bits."""
    bits, stuffed = (EXTENDED_BITS, EXTENDED_STUFFED) if extended \
        else (STANDARD_BITS, STANDARD_STUFFED)
    return bits + 8 * data_length + (stuffed + 8 * data_length - 1) // 4


def cycle_bits(layouts: tuple[EncoderLayout, ...], sync: bool) -> int:
    """Return the worst-case length of one answer of each, and of SYNC if there is one, bits."""
    return sum(frame_bits(layout.data_length, layout.extended) for layout in layouts) \
        + (frame_bits(0, False) if sync else 0)


def check_bus_load(layouts: tuple[EncoderLayout, ...], sync: bool, rate: float,
                   bitrate: int) -> None:
    """Raise SettingError if the bit rate, bit/s, cannot carry the rate, Hz, with the highest."""
    bits = cycle_bits(layouts, sync)
    load = bits * rate / bitrate
    if load > MAXIMUM_LOAD:
        raise SettingError(
            'rate', rate,
            f'at most {MAXIMUM_LOAD * bitrate / bits:.0f} Hz at can.bitrate {bitrate}: a cycle of '
            f'{"SYNC and " if sync else ""}{NUMBER_WORDS[len(layouts)]} answers has up to {bits} '
            f'bits, and {bits} bits x {rate:g} Hz / {bitrate} bit/s = {100.0 * load:.0f} % bus '
            f'load, beyond {100.0 * MAXIMUM_LOAD:.0f} %')
