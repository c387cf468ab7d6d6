# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The states of CiA 402 by the statusword, and the controlword of each next transition."""

import pytest
from spm_haptic_master.drives.cia402 import controlword, ERROR_WORDS, State, state_of
from spm_haptic_master.encoders import canopen

# CiA 402: bits 7 to 0 of the statusword, x for any, and the command of the next transition towards
# Operation enabled; from a fault there is none, and nothing but an acknowledgement resets it.
TABLE = {
    'x0xx0000': (State.NOT_READY, 0x00),
    'x1xx0000': (State.DISABLED, 0x06),
    'x01x0001': (State.READY, 0x07),
    'x01x0011': (State.SWITCHED_ON, 0x0F),
    'x01x0111': (State.ENABLED, 0x0F),
    'x00x0111': (State.QUICK_STOP, 0x00),
    'x0xx1111': (State.REACTING, 0x00),
    'x0xx1000': (State.FAULT, 0x00),
}


def test_every_statusword_is_the_state_of_the_standard_and_gets_its_command():
    found = set()
    for word in (*range(1 << 8), 0xFF37, 0x1208):
        bits = f'{word & 0xFF:08b}'
        matching = [
            row
            for pattern, row in TABLE.items()
            if all(p in ('x', b) for p, b in zip(pattern, bits, strict=True))
        ]
        state, command = matching[0] if matching else (State.UNKNOWN, 0x00)
        assert state_of(word) is state, f'0x{word:04X}'
        assert controlword(state, True) == command
        assert controlword(state, False) == 0x00
        found.add(state)
    assert found == set(State)


@pytest.mark.parametrize(
    ('code', 'words'),
    [
        (0x2310, 'over current'),
        (0x2320, 'short circuit'),
        (0x2350, 'I2t'),
        (0x3210, 'over-voltage'),
        (0x3220, 'under-voltage'),
        (0x4210, 'temperature of the device'),
        (0x4310, 'temperature of the drive'),
        (0x7121, 'blocked'),
        (0x7300, 'sensor'),
        (0x7305, 'incremental sensor'),
        (0x8250, 'RPDO timeout'),
        (0x8400, 'speed controller'),
        (0x8611, 'following error'),
    ],
)
def test_an_emergency_has_the_words_of_its_code(code, words):
    data = canopen.emcy(11, code, 1).data
    assert words in canopen.emcy_words(data, ERROR_WORDS)
