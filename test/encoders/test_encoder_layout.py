# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Counts in a frame, and the angle they mean."""

from dataclasses import replace
from math import pi

from encoder_frames import LAYOUTS
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from spm_haptic_master.encoders.encoder_layout import angle_from_counts, counts_from_angle

PLAIN = LAYOUTS[0]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(data=st.data())
def test_every_layout_carries_every_angle(data):
    bits = data.draw(st.integers(8, 32))
    mask_bits = data.draw(st.integers(4, bits))
    shift = data.draw(st.integers(0, bits - mask_bits))
    per_turn = data.draw(st.integers(2, 1 << mask_bits))
    length = data.draw(st.integers((bits + 7) // 8, 8))
    layout = replace(
        PLAIN,
        byte_order=data.draw(st.sampled_from(['little', 'big'])),
        bit_length=bits,
        mask=((1 << mask_bits) - 1) << shift,
        signed=data.draw(st.booleans()),
        data_length=length,
        byte_offset=data.draw(st.integers(0, length - (bits + 7) // 8)),
        counts_per_turn=per_turn,
        direction=data.draw(st.sampled_from([1, -1])),
        zero_count=data.draw(st.integers(0, per_turn - 1)),
    )
    angle = data.draw(st.floats(-pi, pi))
    frame = layout.data(angle)
    assert len(frame) == length
    counts = layout.counts(frame)
    apart = (layout.angle(counts) - angle + pi) % (2.0 * pi) - pi
    assert abs(apart) <= pi / per_turn + 1e-9


@pytest.mark.parametrize(
    ('data', 'changes', 'counts'),
    [
        ('05100000', {}, 0x1005),
        ('00001005', {'byte_order': 'big'}, 0x1005),
        ('FFFF05103FAA', {'byte_offset': 2, 'bit_length': 16, 'data_length': 6}, 0x1005),
        # 14 bits at the top of a 16-bit word, two status bits below.
        (
            '4017',
            {'bit_length': 16, 'mask': 0xFFFC, 'data_length': 2, 'byte_order': 'big'},
            0x1005,
        ),
        # Multi-turn: 3 turns and 5 counts; the turns are masked away.
        ('05C00000', {'mask': 0x3FFF}, 5),
        ('FBFFFFFF', {'signed': True}, -5),
        ('FB3F', {'signed': True, 'bit_length': 16, 'mask': 0x3FFF, 'data_length': 2}, -5),
        # Beyond a turn: an error value, not a position.
        ('00400000', {}, None),
        ('FF3F0000', {}, 0x3FFF),
        ('01200000', {'signed': True}, None),
    ],
)
def test_counts_are_read_as_the_layout_defines(data, changes, counts):
    assert replace(PLAIN, **changes).counts(bytes.fromhex(data)) == counts


@pytest.mark.parametrize(
    ('counts', 'zero', 'direction', 'turns'),
    [
        (0, 0, 1, 0.0),
        (4096, 0, 1, 0.25),
        (4096, 0, -1, -0.25),
        (12288, 0, 1, -0.25),
        (8192, 0, 1, 0.5),
        (8192, 0, -1, 0.5),
        (100, 16284, 1, 200 / 16384),
        (0, 1, 1, -1 / 16384),
        (0, 1, -1, 1 / 16384),
    ],
)
def test_angle_wraps_into_half_a_turn_to_either_side(counts, zero, direction, turns):
    angle = angle_from_counts(counts, zero, direction, 16384)
    assert angle == pytest.approx(turns * 2.0 * pi, abs=1e-15)
    assert counts_from_angle(angle, zero, direction, 16384) == counts


def test_rolling_counter_and_status_bits():
    layout = replace(
        PLAIN,
        data_length=6,
        counter_byte=4,
        counter_mask=0xF0,
        status_byte=5,
        status_mask=0x81,
        status_good=0x80,
    )
    assert layout.data(0.3)[4:] == bytes((0x00, 0x80))
    assert layout.data(0.3, 5)[4:] == bytes((0x50, 0x80))
    assert [layout.counter(layout.data(0.3, count)) for count in (0, 15, 16, 21)] == [0, 15, 0, 5]
    assert layout.counter_modulus == 16
    assert layout.healthy(layout.data(0.3))
    assert not layout.healthy(bytes((*layout.data(0.3)[:5], 0x01)))
    assert layout.angle(layout.counts(layout.data(0.3, 9))) == pytest.approx(0.3, abs=2e-4)
    assert PLAIN.counter(PLAIN.data(0.3, 5)) is None
    assert PLAIN.healthy(bytes([0xFF]) * PLAIN.data_length)
