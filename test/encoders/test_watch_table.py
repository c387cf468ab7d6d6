# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The line of each encoder while an arm of the device is turned."""

from dataclasses import replace

from encoder_frames import LAYOUTS
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.scan_report import Expected
from spm_haptic_master.encoders.watch_table import watch_lines

# Four bytes of counts, 1000 in a turn, and status bits in the last encoder's third byte.
PLAIN = [replace(layout, counts_per_turn=1000) for layout in LAYOUTS]
STATUS = replace(PLAIN[3], bit_length=16, status_byte=2, status_mask=0x01, status_good=0)
EXPECTED = Expected((*PLAIN[:3], STATUS), (1, 2, 3, 4), 1000.0)


def scan_of(*frames):
    """Return a scan of frames: identifier, counts and time, s."""
    scan = BusScan(layouts=EXPECTED.layouts)
    for identifier, counts, stamp in frames:
        scan.feed(canopen.frame(identifier, counts.to_bytes(4, 'little'), stamp))
    return scan


def test_each_encoder_has_its_counts_its_motion_and_its_age():
    scan = scan_of(
        (0x181, 0, 1.0),
        (0x181, 250, 1.1),
        (0x182, 10, 1.1),
        (0x182, 20, 1.1),
        (0x183, 5000, 1.2),
        (0x184, 0x10000 + 7, 1.3),
    )
    scan.feed(canopen.sdo_answer(1, *canopen.ERROR_REGISTER, 0, 1))
    scan.feed(canopen.sdo_answer(2, *canopen.ERROR_REGISTER, 0x04, 1))
    first, second, third, fourth = watch_lines(scan, EXPECTED)
    assert first == (
        'joint_1a   node   1  0x181  counts     250    90.00 deg  span   90.00 deg  '
        'age   200 ms  error register 0x00  <- moves now'
    )
    assert second == (
        'joint_1b   node   2  0x182  counts      20     7.20 deg  span    3.60 deg  '
        'age   200 ms  error register 0x04 (voltage)     moves, too'
    )
    assert third.startswith('joint_1c   node   3  0x183  counts       -  beyond a turn  span')
    assert 'age   100 ms  error register not read  (1 of 1 frames have counts of' in third
    assert fourth == (
        'joint_3a   node   4  0x184  counts       7     2.52 deg  span    0.00 deg  '
        'age     0 ms  status ERROR  error register not read'
    )
    # Nothing has moved since.
    assert not any('moves' in line for line in watch_lines(scan, EXPECTED))


def test_an_encoder_that_is_not_heard_or_has_other_frames_is_named():
    scan = BusScan(layouts=EXPECTED.layouts)
    scan.feed(canopen.frame(0x182, bytes(6), 1.0))
    scan.feed(canopen.frame(0x184, bytes(4), 1.0))
    first, second, _, fourth = watch_lines(scan, replace(EXPECTED, node_ids=None))
    assert first == 'joint_1a   0x181  no frames'
    assert second == 'joint_1b   0x182  frames of 6 bytes, encoders.data_length is 4'
    assert 'status good' in fourth
