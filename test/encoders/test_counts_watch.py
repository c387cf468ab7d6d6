# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the counts of an encoder tell of its motion, and of a layout that does not fit."""

from dataclasses import replace
from math import pi

from encoder_frames import LAYOUTS
import numpy as np
import pytest
from spm_haptic_master.encoders.counts_watch import CountsWatch, smaller_resolution

# Two bytes of counts, 12 bits of them in a turn.
LAYOUT = replace(
    LAYOUTS[0],
    data_length=2,
    byte_offset=0,
    bit_length=16,
    byte_order='little',
    mask=0,
    signed=False,
    counts_per_turn=4096,
    status_mask=0,
)
COUNT = 2.0 * pi / 4096


def watch_of(counts, **changes):
    """Return a watch to which a little-endian encoder has sent counts."""
    layout = replace(LAYOUT, **changes)
    watch = CountsWatch(layout)
    for number, value in enumerate(counts):
        watch.take(value.to_bytes(layout.data_length, 'little'), 0.001 * number)
    return watch


@pytest.mark.parametrize(
    ('counts', 'position', 'span', 'travel', 'changes'),
    [
        ([], 0, 0, 0, 0),
        ([700], 0, 0, 0, 0),
        ([700, 703, 703, 701], 1, 3, 5, 2),
        ([700, 697, 701], 1, 4, 7, 2),
        # Over the end of a turn in either direction.
        ([4095, 1], 2, 2, 2, 1),
        ([1, 4095], -2, 2, 2, 1),
        # Just below half a turn, and half a turn, which may be either way.
        ([0, 2047], 2047, 2047, 2047, 1),
        ([0, 2048], -2048, 2048, 2048, 1),
        # A value beyond a turn is no motion.
        ([4000, 4096, 4001], 1, 1, 1, 1),
    ],
)
def test_counts_are_followed_over_the_end_of_a_turn(counts, position, span, travel, changes):
    watch = watch_of(counts)
    assert watch.track.frames == len(counts)
    assert watch.track.position == position
    assert watch.track.travel == travel
    assert watch.track.changes == changes
    assert watch.span == pytest.approx(span * COUNT)


@pytest.mark.parametrize(('counts', 'position'), [([3, 53], 50), ([3, 54], -50), ([100, 0], 1)])
def test_a_turn_may_be_an_odd_number_of_counts(counts, position):
    assert watch_of(counts, counts_per_turn=101).track.position == position


@pytest.mark.parametrize(
    ('counts', 'angle'),
    [([], None), ([5000], None), ([0], 0.0), ([1024], pi / 2.0), ([4095], 4095 * COUNT)],
)
def test_the_angle_is_that_of_the_latest_counts_in_a_turn(counts, angle):
    assert watch_of(counts).angle == (None if angle is None else pytest.approx(angle))


def test_the_angle_of_negative_counts_is_in_a_turn_too():
    watch = CountsWatch(replace(LAYOUT, signed=True))
    watch.take(b'\xff\xff', 0.0)
    assert watch.angle == pytest.approx(4095 * COUNT)


def test_a_frame_of_another_length_is_not_one_of_the_encoder():
    watch = watch_of([7])
    watch.take(bytes(3), 2.0)
    assert watch.other_length == 3
    assert watch.heard == 0.0
    assert watch.track.frames == 1


def test_an_encoder_is_healthy_until_its_status_bits_report_an_error():
    watch = CountsWatch(replace(LAYOUT, status_byte=1, status_mask=0x80, status_good=0))
    assert watch.healthy
    watch.take(b'\x00\x80', 1.5)
    assert watch.heard == 1.5
    assert not watch.healthy
    watch.take(b'\x00\x00', 1.6)
    assert watch.healthy


@pytest.mark.parametrize(
    ('counts', 'moved'),
    [
        # 0.18 deg, the noise of an encoder at rest, and 0.26 deg.
        ([100, 102], 0.0),
        ([100, 103], 3 * COUNT),
        ([100, 97], 3 * COUNT),
    ],
)
def test_noise_is_no_movement(counts, moved):
    watch = watch_of(counts)
    assert watch.moved() == pytest.approx(moved)
    assert watch.moved() == 0.0


def test_movement_is_counted_from_the_last_call():
    watch = watch_of([100, 150])
    watch.moved()
    watch.take((154).to_bytes(2, 'little'), 1.0)
    assert watch.moved() == pytest.approx(4 * COUNT)


ONE_BYTE = {'data_length': 1, 'bit_length': 8, 'counts_per_turn': 100}
BIG = {'byte_order': 'big', 'counts_per_turn': 1 << 16}
OTHER_SETTING = 'encoders.counts_per_turn ({}), .mask, .byte_offset or .byte_order is another one'
OTHER_ORDER = 'encoders.byte_order is big, and little fits'
JUMPS = (
    'its counts jump as it turns: encoders.byte_order is big, and in the order little '
    'they do not jump'
)


@pytest.mark.parametrize(
    ('changes', 'counts', 'problem'),
    [
        ({}, [], None),
        ({}, [100, 101, 102], None),
        # An error value in one frame of five, and in more.
        ({}, [0xFFFF, 1, 2, 3, 4], None),
        (
            {},
            [0xFFFF, 1, 2, 3],
            f'1 of 4 frames have counts of a turn or more: {OTHER_SETTING.format(4096)}',
        ),
        (
            ONE_BYTE,
            [100, 1, 2],
            f'1 of 3 frames have counts of a turn or more: {OTHER_SETTING.format(100)}',
        ),
        (
            {'byte_order': 'big'},
            [0x0010, 0x0020],
            f'2 of 2 frames have counts of a turn or more: {OTHER_ORDER}',
        ),
        (
            {},
            [0x1000, 0x2000],
            '2 of 2 frames have counts of a turn or more: encoders.byte_order is little, '
            'and big fits',
        ),
        # Too few changes, and just enough.
        (BIG, range(10), None),
        (BIG, range(11), JUMPS),
        # Steps of 1, and one or two of 256: the counts travel 8.7 and 7.8 times as far as in the
        # other order.
        (BIG, [*range(10), 9 + 256], JUMPS),
        (BIG, [*range(17), 16 + 256, 16 + 512], None),
        # They jump, but the other order does not fit either: a third is beyond a turn there.
        (
            {'byte_order': 'big', 'counts_per_turn': 0xF000},
            [*range(20), *[0xF012] * 10],
            None,
        ),
    ],
)
def test_a_layout_that_does_not_fit_is_named(changes, counts, problem):
    assert watch_of(counts, **changes).problem() == problem


@pytest.mark.parametrize(
    ('largest', 'counts_per_turn', 'smaller'),
    [
        (0, (4, 4), 2),
        (1, (4, 4), 2),
        (2, (8, 8), 4),
        (2, (4, 4), None),
        (8191, (1 << 17, 1 << 17), 8192),
        (8192, (1 << 17, 1 << 17), 16384),
        (65535, (1 << 17, 1 << 17), 65536),
        (65536, (1 << 17, 1 << 17), None),
        (-1, (1 << 17, 1 << 17), None),
        # The smallest resolution decides.
        (8191, (1 << 17, 1 << 14), 8192),
        (8192, (1 << 17, 1 << 14), None),
    ],
)
def test_the_smaller_resolution_is_the_next_power_of_two(largest, counts_per_turn, smaller):
    angles = 2.0 * pi * np.array([[0.0, 0.0], [largest, 0.0]]) / counts_per_turn
    assert smaller_resolution(angles, counts_per_turn) == smaller


def test_no_motion_has_no_smaller_resolution():
    assert smaller_resolution(np.empty((0, 2)), (4096, 4096)) is None
