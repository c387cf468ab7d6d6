# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The states of CiA 402 by the statusword, and the controlword of each next transition."""

from collections import Counter

import pytest
from spm_haptic_master.drives.cia402 import controlword, State, state_of

# CiA 402, table of the statusword: x stands for any bit; bits 6 to 0.
TABLE = {
    'x0xx0000': State.NOT_READY, 'x1xx0000': State.DISABLED, 'x01x0001': State.READY,
    'x01x0011': State.SWITCHED_ON, 'x01x0111': State.ENABLED, 'x00x0111': State.QUICK_STOP,
    'x0xx1111': State.REACTING, 'x0xx1000': State.FAULT}


def expected(word):
    """Return the state by the table, bit by bit."""
    bits = f'{word & 0xFF:08b}'
    found = [state for pattern, state in TABLE.items()
             if all(p in ('x', b) for p, b in zip(pattern, bits, strict=True))]
    assert len(found) <= 1
    return found[0] if found else State.UNKNOWN


def test_every_statusword_is_the_state_of_the_standard():
    found = Counter()
    for word in range(1 << 16):
        state = state_of(word)
        found[state] += 1
        assert state is expected(word), f'0x{word:04X}'
    assert set(found) == set(State)


@pytest.mark.parametrize('state', State)
def test_without_a_wish_to_operate_every_state_gets_disable_voltage(state):
    assert controlword(state, False) == 0x00


@pytest.mark.parametrize(('state', 'word'), [
    (State.NOT_READY, 0x00), (State.DISABLED, 0x06), (State.READY, 0x07),
    (State.SWITCHED_ON, 0x0F), (State.ENABLED, 0x0F), (State.QUICK_STOP, 0x00),
    (State.REACTING, 0x00), (State.FAULT, 0x00), (State.UNKNOWN, 0x00)])
def test_each_state_gets_the_command_of_its_next_transition(state, word):
    assert controlword(state, True) == word


def test_no_statusword_leads_to_a_fault_reset():
    """Only an acknowledgement resets a fault."""
    assert all(not controlword(state_of(word), operate) & 0x80
               for word in range(1 << 16) for operate in (True, False))
