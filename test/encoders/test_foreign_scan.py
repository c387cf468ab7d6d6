# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""can_scan against encoders of another stack, and with counts that do not fit their layout."""

from dataclasses import replace
import random

import can
from disturbance import SKIPPED
from encoder_frames import LAYOUTS, T0
from foreign_nodes import BARE, COUNTS, foreign_bus, Held, objects_of
import pytest
from spm_haptic_master.encoders import bus_scan, canopen, scan_report
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.counts_watch import CountsWatch
from spm_haptic_master.encoders.scan_report import Expected
from spm_haptic_master.encoders.watch_table import watch_lines
from spm_haptic_master.tools import can_scan, command_line

NODES = (1, 2, 3, 4)
GOOD = 'all four encoders are there, as configured'


@pytest.fixture
def run(capsys, channel, monkeypatch):
    """Run can_scan on the bus; return its exit code and output."""
    monkeypatch.setattr(bus_scan, 'SYNC_LISTEN', 0.3)
    monkeypatch.setattr(command_line, 'SIGNALS', ())

    def run(*args, seconds=1.0, rate=50.0):
        capsys.readouterr()
        code = can_scan.main(
            [
                'can_scan',
                *('-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}'),
                *('-p', f'rate:={rate}', '--seconds', str(seconds), *args),
            ]
        )
        out, err = capsys.readouterr()
        return code, out + err

    return run


def test_E2_an_error_register_is_no_bus_as_configured(channel, run):
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as encoders:
        code, text = run('--start')
        assert code == 0 and GOOD in text, text
        encoders[3].put(0x10, 0x1001)
        code, text = run('--start')
    assert code == 1
    assert '  joint_3a: error register 0x10 (communication)\n' in text


def test_E10_an_encoder_that_ends_during_the_scan_is_not_as_configured(channel, run):
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as encoders:
        ending = encoders[1]
        answer = ending.on_sync

        def end():
            if ending.syncs < 10:
                answer()
            else:
                ending.node.nmt.stop_heartbeat()

        ending.on_sync = end
        code, text = run('--start', seconds=1.5)
    if 'this machine is too busy' in text:
        pytest.skip(f'{SKIPPED}SYNC was not sent at its rate')
    assert code == 1
    assert 'joint_1b: 0x182 answers 10 of ' in text
    assert ', the last one 1.' in text
    assert 'joint_1b: its last heartbeat came 1.' in text
    assert 'joint_1a: 0x181' not in text


@pytest.mark.parametrize(
    ('share', 'good'),
    [
        (0.0, True),
        (0.03, False),
        (1.0, False),
    ],
)
def test_item_4_the_verdict_counts_lost_answers(share, good):
    """Of 150 answers 3 % are not as configured; one may be under way at the end."""
    scan = BusScan(0x80, LAYOUTS)
    rng = random.Random(5)
    for number in range(150):
        at = T0 + 0.02 * number
        scan.feed(canopen.frame(0x80, b'', at))
        for node in NODES:
            lost = node == 2 and number > 2 and rng.random() < share
            if not lost and (number < 149 or node != 3):
                scan.feed(canopen.frame(0x180 + node, bytes(4), at + 1e-3))
    found = scan_report.problems(scan, Expected(LAYOUTS, NODES, 50.0))
    answered = scan.frames[False, 0x182].count
    assert found == (
        []
        if good
        else [f'joint_1b: 0x182 answers {answered} of 150 SYNC']
        if share < 1
        else ['joint_1b: 0x182 answers 3 of 150 SYNC, the last one 2.94 s before the end']
    )


def test_E11_a_verdict_names_the_emergency_that_was_heard(channel, run):
    """SYNC with a counter is expected by the device, by 0x1019."""
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as encoders:
        encoders[1].on_sync = lambda: encoders[1].node.emcy.send(0x8240, 0x11)
        code, text = run('--start')
    assert code == 1
    assert (
        'joint_1b: 0x182 missing; its node 2 reports EMCY 0x8240 unexpected SYNC length, error '
        'register 0x11' in text
    )
    assert '0x1800:02' not in text


def test_E12_devices_with_one_node_id_are_counted(channel, run):
    """As delivered: four with node id 127."""
    with can.Bus(interface='virtual', channel=channel):
        buses = [
            foreign_bus(
                channel,
                (127, objects_of(127) | {(0x1018, 4): Held(serial, access='ro')}),
            )
            for serial in (11, 12, 13, 14)
        ]
        with buses[0], buses[1], buses[2], buses[3]:
            code, text = run('--start')
    sentence = 'four devices have node id 127: give each its own, one at a time on the bus'
    assert code == 1
    assert f'not as configured:\n  {sentence}' in text
    assert f'# none: {sentence}' in text


def test_E12_two_devices_with_the_id_of_a_joint_are_named_and_not_counted(channel, run):
    with (
        foreign_bus(channel, *((n, objects_of(n)) for n in NODES)),
        foreign_bus(channel, (2, objects_of(2) | {(0x1018, 4): Held(9, access='ro')})),
    ):
        code, text = run('--start')
    assert code == 1
    assert 'two devices have node id 2: give each' in text
    assert ' times in ' not in text


@pytest.mark.parametrize('scaled', [True, False])
def test_E13_the_resolution_is_read_and_printed(channel, run, scaled):
    changes = {'o6001': Held(4096)} if scaled else {'o6000': Held(0, 2), 'o6501': Held(4096)}
    with foreign_bus(channel, *((n, objects_of(n, **changes)) for n in NODES)):
        code, text = run('--start')
        assert code == 1
        assert (
            '  joint_1a: it has 4096 counts per turn, encoders.counts_per_turn is 16384\n' in text
        )
        assert '      counts_per_turn: [4096, 4096, 4096, 4096]\n' in text
        code, text = run('--start', '-p', 'encoders.counts_per_turn:=[4096, 4096, 4096, 4096]')
        assert code == 0, text


@pytest.mark.parametrize(
    ('bits', 'order', 'configured', 'words'),
    [
        # A 12-bit encoder, big-endian, in two bytes.
        (12, 'big', {'byte_order': 'little'}, ', and big fits'),
        (
            16,
            'big',
            {'byte_order': 'little'},
            'its counts jump as it turns: encoders.byte_order is',
        ),
        (14, 'little', {'counts_per_turn': 4096}, 'encoders.counts_per_turn (4096), .mask'),
        (12, 'big', {}, None),
        (16, 'little', {}, None),
    ],
)
def test_E13_counts_show_a_wrong_byte_order_or_resolution(bits, order, configured, words):
    right = replace(
        LAYOUTS[0],
        data_length=2,
        bit_length=16,
        byte_order=order,
        counts_per_turn=1 << bits,
        zero_count=0,
    )
    watch = CountsWatch(replace(right, **configured))
    for number in range(200):
        watch.take(right.data(0.02 * number), T0 + 0.02 * number)
    problem = watch.problem()
    assert problem is None if words is None else words in problem
    scan = BusScan(0x80, [watch.layout])
    for number in range(200):
        scan.feed(canopen.frame(0x80, b'', T0 + 0.02 * number))
        scan.feed(canopen.frame(0x181, right.data(0.02 * number), T0 + 0.02 * number))
    found = scan_report.problems(scan, Expected((watch.layout,), None, 50.0))
    assert found == ([] if words is None else [f'joint_1a: 0x181: {problem}'])


def test_E14_nodes_that_answer_and_send_nothing_are_named(channel, run):
    held = {n: objects_of(n, o1800_02=Held(254, 1), o1017=Held(0, 2)) for n in range(1, 7)}
    with foreign_bus(channel, *held.items()) as encoders:
        for encoder in encoders:
            encoder.on_sync = lambda: None
        code, text = run()
    assert code == 1
    assert 'no frames at all' not in text
    assert (
        'no frames, but answers to SDO of node 1, 2, 3, 4, 5, 6: they do not send yet. Start them '
        '(can_scan --start), and set them up (can_setup --write)' in text
    )


@pytest.mark.parametrize(
    ('phases', 'good'),
    [
        ((0.0, 1e-3, 2e-3, 3e-3), True),
        ((9e-3, 2e-3, 5e-3, 7e-3), False),
    ],
)
def test_E6_phases_without_sync_are_named(phases, good):
    scan = BusScan(None, LAYOUTS)
    for number in range(100):
        for layout, phase in zip(LAYOUTS, phases, strict=True):
            scan.feed(canopen.frame(layout.can_id, layout.data(0.1), T0 + 0.01 * number + phase))
    expected = Expected(LAYOUTS, NODES, 100.0)
    found = scan_report.problems(scan, expected)
    remark = scan_report.remark_on_phases(scan, expected)
    words = 'SYNC is needed (encoders.sync_id: 0x80, and can_setup)'
    if good:
        assert found == []
        assert remark.startswith('without SYNC the frames come at phases of ')
        assert 'joint_1a 0.0, joint_1b 1.0, joint_1c 2.0, joint_3a 3.0 ms in 10 ms' in remark
    else:
        (line,) = found
        assert remark is None
        assert 'no set is complete within half a period' in line
    assert words in (remark or line)


def test_a_heartbeat_that_is_too_slow_for_the_driver_is_named():
    scan = BusScan(0x80, LAYOUTS)
    for number in range(200):
        at = T0 + 0.02 * number
        scan.feed(canopen.frame(0x80, b'', at))
        for node in NODES:
            scan.feed(canopen.frame(0x180 + node, bytes(4), at + 1e-3))
            if number % 50 == 0:
                scan.feed(canopen.frame(0x700 + node, b'\x05', at))
    found = scan_report.problems(scan, Expected(LAYOUTS, NODES, 50.0, heartbeat_timeout=0.5))
    assert found == [
        f'{layout.joint}: its heartbeats come 1.00 s apart, can.heartbeat_timeout is 0.5 s: set '
        '0x1017 (can_setup)'
        for layout in LAYOUTS
    ]


def test_item_4_watch_shows_which_encoder_moves(channel, run):
    """One line an encoder; joint_1c is turned."""
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as encoders:
        turned = encoders[2]
        answer = turned.on_sync

        def turn():
            turned.counts = (turned.counts + 40) % COUNTS
            answer()

        turned.on_sync = turn
        encoders[3].put(0x04, 0x1001)
        code, text = run('--watch', '--start', seconds=2.2)
    assert code == 0, text
    lines = [line for line in text.splitlines() if line.startswith('joint_')][-4:]
    assert [line.split()[0] for line in lines] == [each.joint for each in LAYOUTS]
    assert 'node   1  0x181  counts     100     2.20 deg  span    0.00 deg  age ' in lines[0]
    assert [('<- moves now' in line) for line in lines] == [False, False, True, False]
    assert 'error register 0x00' in lines[0]
    assert 'error register 0x04 (voltage)' in lines[3]


def test_item_4_watch_has_span_status_and_what_does_not_fit():
    layout = replace(
        LAYOUTS[0], data_length=5, status_byte=4, status_mask=1, status_good=1, zero_count=0
    )
    scan = BusScan(0x80, [layout])
    expected = Expected((layout,), None, 50.0)
    assert watch_lines(scan, expected) == ['joint_1a   0x181  no frames']
    scan.feed(canopen.frame(0x181, bytes(4), T0))
    (line,) = watch_lines(scan, expected)
    assert line == 'joint_1a   0x181  frames of 4 bytes, encoders.data_length is 5'
    for number in range(91):
        data = layout.data(0.0174532925 * (number - 45), healthy=number < 90)
        scan.feed(canopen.frame(0x181, data, T0 + 0.02 * number))
    scan.feed(canopen.frame(0x80, b'', T0 + 3.0))
    (line,) = watch_lines(scan, expected)
    assert 'counts    2048    45.00 deg  span   90.00 deg  age  1200 ms  status ERROR' in line


def test_encoders_without_any_optional_object_are_as_configured(channel, run):
    with foreign_bus(channel, *((n, objects_of(n, **BARE)) for n in NODES)):
        code, text = run('--start')
    assert code == 0 and GOOD in text and 'counts_per_turn' not in text, text
