# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Error frames in words, by Linux's linux/can/error.h, which python-can passes on unchanged."""

from __future__ import annotations

import can

# Error classes: bits of an error frame's identifier.
BUS_OFF = 0x040
RESTARTED = 0x100
CONTROLLER = 0x004
# Words for the error classes, by bit.
CLASS_WORDS = {
    0x001: 'transmit timeout', 0x002: 'lost arbitration', CONTROLLER: 'controller problem',
    0x008: 'protocol violation', 0x010: 'transceiver', 0x020: 'no acknowledge (is any other node '
    'on the bus?)', BUS_OFF: 'bus-off', 0x080: 'bus error', RESTARTED: 'controller restarted',
}
# Words for the bits of data byte 1 of a controller problem.
CONTROLLER_WORDS = {
    0x01: 'receive overflow', 0x02: 'transmit overflow', 0x04: 'receive warning level',
    0x08: 'transmit warning level', 0x10: 'receive error passive', 0x20: 'transmit error passive',
    0x40: 'error active again',
}


def error_words(message: can.Message) -> str:
    """Return the errors that an error frame reports, in words."""
    identifier, data = message.arbitration_id, message.data
    words = [word for bit, word in CLASS_WORDS.items() if identifier & bit]
    if identifier & CONTROLLER and len(data) > 1:
        words += [word for bit, word in CONTROLLER_WORDS.items() if data[1] & bit]
    return ', '.join(words) or f'unknown error 0x{identifier:X}'


def is_bus_off(message: can.Message) -> bool:
    """Return whether an error frame reports that the controller is bus-off."""
    return bool(message.arbitration_id & BUS_OFF)
