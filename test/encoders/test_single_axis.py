# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Insertion and gripper: what is a reading, when there is none, and that no set waits for them."""

from contextlib import closing, nullcontext
import math
import time

from encoder_frames import cycle, decoder, PERIOD, record, T0, values
from foreign_nodes import foreign_bus, objects_of
import pytest
from spm_haptic_master.encoders import bus_scan, canopen, canopen_network
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.teleoperation.conditions import INSERTION_DELAY, INSERTION_PERIODS
from spm_haptic_master.tools import can_scan, can_setup, command_line

# A slide of 1 m with 10,000 counts a metre, and a gripper of 4096 counts a turn.
SLIDE = {
    'insertion__id': 0x185,
    'insertion__counts_per_metre': 1e4,
    'insertion__zero_count': 500,
    'insertion__direction': -1,
    'insertion__range': (0.0, 0.2),
    'insertion__speed_limit': 1.0,
}
GRIPPER = {'gripper__id': 0x186, 'gripper__counts_per_turn': 4096}


def slide(number, metres, identifier=0x185):
    """Return the frame of the slide in a cycle."""
    counts = round(500 - 1e4 * metres) % (1 << 32)
    return canopen.frame(identifier, counts.to_bytes(4, 'little'), T0 + PERIOD * number + 9e-4)


def readings(taker, messages):
    """Return what the axes read in some frames."""
    for message in messages:
        taker.feed(message)
    found = list(taker.readings)
    taker.readings.clear()
    return found


def test_a_reading_is_the_position_at_the_sync_of_its_cycle():
    taker = decoder(**SLIDE, **GRIPPER)
    grip = canopen.frame(0x186, (512).to_bytes(4, 'little'), T0 + 9.5e-4)
    first, second = readings(taker, [*cycle(0), slide(0, 0.05), grip])
    assert (first.name, second.name) == ('insertion', 'gripper')
    assert first.stamp == second.stamp == pytest.approx(T0 * 1e9, abs=1000)
    assert first.position == pytest.approx(0.05)
    assert second.position == pytest.approx(math.pi / 4)


def test_no_set_waits_for_an_axis_and_none_is_part_of_one():
    """The same sets, frame by frame, with and without the axes, lost or late ones too."""
    plain = decoder()
    both = decoder(**SLIDE, **GRIPPER)
    for number in range(40):
        frames = cycle(number)
        if number % 7 == 3:
            del frames[2]
        expected = [plain.feed(message) for message in frames]
        if number % 3:
            both.feed(slide(number - 1, 0.05))
        assert [both.feed(message) for message in frames] == expected
        if number % 5:
            assert both.feed(slide(number, 0.05)) is None
    assert both.assembler.counters == plain.assembler.counters
    assert both.caution(T0 + 40 * PERIOD) == plain.caution(T0 + 40 * PERIOD)


@pytest.mark.parametrize(
    ('metres', 'good'),
    [
        (0.0, True),
        (-0.0039, True),
        (-0.0041, False),
        (0.2041, False),
    ],
)
def test_a_reading_beyond_its_range_by_two_per_cent_is_none(metres, good):
    taker = decoder(**SLIDE)
    found = readings(taker, [*cycle(0), slide(0, metres)])
    assert len(found) == good
    fault = taker.axes[0].fault(T0 + PERIOD)
    assert fault is None if good else fault.startswith('insertion: out of range (')


def test_a_jump_is_silent_until_the_slide_has_settled_and_teleop_has_disengaged():
    """0.2 mm a period is slow, 5 mm is not: also where it stays there."""
    taker = decoder(**SLIDE)
    spoken = []
    for number in range(60):
        metres = 0.05 + 2e-4 * number + (0.005 if number >= 10 else 0.0)
        spoken.append(bool(readings(taker, [*cycle(number), slide(number, metres)])))
        if number == 11:
            assert taker.axes[0].fault(T0 + PERIOD * 13.5) == 'insertion: faster than 1 per second'
    silent = [number for number in range(60) if not spoken[number]]
    assert silent == list(range(10, 10 + len(silent)))
    # Twice as long as an insertion may be missing: messages are late by some ms.
    assert len(silent) * PERIOD > 2.0 * (INSERTION_PERIODS * PERIOD + INSERTION_DELAY)
    assert len(silent) < 40


def axis_of(**overrides):
    """Return the slide of a decoder."""
    return decoder(**SLIDE, **overrides).axes[0]


def spoken_at(axis, *places):
    """Return whether the slide has a reading at each time, s, and position, m."""
    spoken = []
    for seconds, metres in places:
        spoken.append(axis.take(slide(0, metres), T0 + seconds) is not None)
    return spoken


@pytest.mark.parametrize(
    ('rate', 'settled'),
    [
        (1000.0, 0.033),
        (100.0, 0.06),
    ],
)
def test_a_slide_has_settled_three_periods_and_30_ms_after_a_jump(rate, settled):
    axis = axis_of(rate=rate)
    jump = (0.0, 0.1), (0.001, 0.12)
    found = spoken_at(axis, *jump, (settled, 0.12), (settled + 0.002, 0.12))
    assert found == [True, False, False, True]


@pytest.mark.parametrize(
    ('seconds', 'metres', 'good'),
    [
        # At most 1 m/s: 1 mm in a period of 1 ms, however short the time was; 5 mm in 5 ms.
        (0.001, 0.1009, True),
        (0.001, 0.1011, False),
        (0.0001, 0.1009, True),
        (0.005, 0.1049, True),
        (0.005, 0.0951, True),
        (0.005, 0.1051, False),
        (0.005, 0.0949, False),
        # A time that stands still, or goes back, has no speed.
        (0.0, 0.1, False),
        (-0.001, 0.1, False),
    ],
)
def test_a_slide_that_is_faster_than_its_limit_has_no_reading(seconds, metres, good):
    assert spoken_at(axis_of(), (0.0, 0.1), (seconds, metres)) == [True, good]


@pytest.mark.parametrize(
    ('counts', 'position'),
    [
        (0, 500.0),
        (499, 1.0),
        (501, -1.0),
        (500 - (1 << 31), -(2.0**31)),
    ],
)
def test_a_slide_that_is_calibrated_reads_its_counts_whatever_they_are(counts, position):
    axis = axis_of()
    axis.read_counts()
    message = canopen.frame(0x185, (counts % (1 << 32)).to_bytes(4, 'little'))
    assert abs(axis.take(message, T0).position) == pytest.approx(abs(position))


def test_a_rejected_frame_is_the_reason_for_three_periods():
    axis = axis_of()
    spoken_at(axis, (0.0, 0.1))
    axis.take(canopen.frame(0x185, bytes(3), T0 + 0.01), T0 + 0.01)
    assert axis.fault(T0 + 0.0129) == 'insertion: 3 bytes instead of 4'
    assert axis.fault(T0 + 0.0131) == 'insertion missing (no frames)'


def test_a_silent_node_explains_the_missing_readings():
    taker = decoder(**SLIDE, insertion__node_id=5)
    taker.feed(canopen.frame(0x705, b'\x7f', T0))
    assert taker.axes[0].fault(T0 + 0.1) == 'insertion missing (pre-operational)'


@pytest.mark.parametrize(
    ('given', 'ends'),
    [
        ({'insertion__range': (0.0, 0.2)}, (-0.004, 0.204)),
        ({'insertion__range': (-0.1, 0.4)}, (-0.11, 0.41)),
    ],
)
def test_the_margin_of_a_range_is_two_per_cent_at_either_end(given, ends):
    axis = decoder(**SLIDE | given).axes[0]
    assert axis.limits.bounds == pytest.approx(ends)


@pytest.mark.parametrize('largest', [32767, 32769])
def test_the_range_of_a_slide_is_within_half_of_its_counts(largest):
    given = SLIDE | {
        'insertion__bit_length': 16,
        'insertion__counts_per_metre': 2e4,
        'insertion__range': (0.0, largest / 2e4),
    }
    refused = pytest.raises(SettingError, match='what 16 bits of counts can hold')
    with nullcontext() if largest < 32768 else refused:
        decoder(**given)


def test_three_periods_without_a_frame_are_missing():
    taker = decoder(**SLIDE)
    axis = taker.axes[0]
    assert axis.fault(T0) == 'insertion missing (no frames)'
    readings(taker, [*cycle(0), slide(0, 0.1)])
    assert axis.fault(T0 + 2.9 * PERIOD) is None
    assert axis.fault(T0 + 3.1 * PERIOD) == 'insertion missing (no frames)'


def test_a_node_with_an_error_has_no_reading():
    taker = decoder(**SLIDE, insertion__node_id=5)
    taker.feed(canopen.emcy(5, 0x5000, 1))
    assert readings(taker, [*cycle(0), slide(0, 0.1)]) == []
    assert 'EMCY 0x5000 device hardware' in taker.axes[0].fault(T0 + PERIOD)
    assert taker.caution(T0) is None


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'insertion__id': 0x181}, "'insertion.id'.*an identifier that joint_1a does not have"),
        ({'insertion__node_id': 3}, "'insertion.node_id'.*a node id that joint_1c does not have"),
        # Its frames would be taken for the heartbeats of a joint's node, or never come.
        ({'insertion__id': 0x703}, "'insertion.id'.*no other use for .*heartbeat of node 3"),
        ({'gripper__id': 0x80}, "'gripper.id'.*an identifier that SYNC does not have"),
        ({'gripper__id': 0x60A}, "'gripper.id'.*no other use for .*SDO request to node 10"),
        ({'insertion__id': 0x800}, "'insertion.id'.*an 11-bit identifier"),
        ({'insertion__range': (0.2, 0.0)}, 'the lesser value first'),
        ({'insertion__byte_offset': 2}, 'ends within the 4 bytes of encoders.data_length'),
        ({'insertion__bit_length': 8}, 'what 8 bits of counts can hold'),
        ({'gripper__id': 0x185}, 'an identifier that insertion does not have'),
    ],
)
def test_settings_that_contradict_each_other_are_refused(given, words):
    with pytest.raises(SettingError, match=words):
        decoder(**SLIDE | GRIPPER | given)


def test_a_recording_has_the_same_readings(tmp_path):
    path = tmp_path / 'a.log'
    record(
        path,
        [
            message
            for number in range(100)
            for message in (*cycle(number), slide(number, 0.05 + 1e-4 * number))
        ],
    )
    source = make_source('replay', values('replay', replay__path=str(path), **SLIDE))
    found = []
    with closing(source):
        end = time.monotonic() + 10.0
        while len(found) < 99 and time.monotonic() < end:
            try:
                source.read(0.01)
            except Exception:  # played to its end
                time.sleep(0.01)
            found += source.take_readings()
    assert [each.position for each in found[:99]] == pytest.approx(
        [0.05 + 1e-4 * number for number in range(99)], abs=1e-4
    )
    assert found[50].stamp - found[0].stamp == pytest.approx(5e7, abs=1e4)


def test_the_simulated_source_has_them_where_they_are_configured():
    with closing(make_source('sim', values('sim', **SLIDE, **GRIPPER))) as source:
        end = time.monotonic() + 10.0
        found = []
        while len(found) < 20 and time.monotonic() < end:
            source.read(0.05)
            found += source.take_readings()
    assert {each.name for each in found} == {'insertion', 'gripper'}
    assert all(
        0.0 <= each.position <= (0.2 if each.name == 'insertion' else 1.05) for each in found
    )
    with closing(make_source('sim', values('sim'))) as source:
        assert source.axes == ()


NODES = (1, 2, 3, 4, 5)
GIVEN = ('-p', 'insertion.id:=0x185', '-p', 'insertion.node_id:=5', '-p', 'rate:=50.0')


def test_a_lost_slide_is_silent_by_itself_and_the_orientation_goes_on(channel):
    """On a bus of another stack: it is started, read, lost."""
    settings = values(
        can__interface='virtual',
        can__channel=channel,
        can__sync='produce',
        rate=50.0,
        can__timeout=0.5,
        can__heartbeat_timeout=2.0,
        **SLIDE | {'insertion__direction': 1, 'insertion__zero_count': 0},
        insertion__node_id=5,
    )
    with (
        foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as nodes,
        closing(make_source('can', settings)) as source,
    ):
        found = []
        end = time.monotonic() + 10.0
        while len(found) < 5 and time.monotonic() < end:
            source.read(0.05)
            found += source.take_readings()
        assert found[-1].position == pytest.approx(0.05)
        nodes[4].on_sync = lambda: None
        sets = 0
        end = time.monotonic() + 1.0
        while time.monotonic() < end:
            sets += source.read(0.05) is not None
        assert sets > 10
        assert source.fault is None
        assert source.caution is None
        assert source.axes[0].fault(time.time()).startswith('insertion missing')


def test_scan_and_set_up_know_the_slide(channel, capsys, monkeypatch):
    monkeypatch.setattr(bus_scan, 'SYNC_LISTEN', 0.3)
    monkeypatch.setattr(can_setup, 'LISTEN', 0.0)
    monkeypatch.setattr(canopen_network, 'ANSWER_TIMEOUT', 0.3)
    monkeypatch.setattr(command_line, 'SIGNALS', ())
    bus = ('-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}', *GIVEN)
    slide_objects = objects_of(
        5,
        o6000=None,
        o6001=None,
        o6002=None,
        o6501=None,
    )
    with foreign_bus(
        channel,
        *((n, objects_of(n)) for n in NODES[:4]),
        (5, slide_objects),
    ):
        assert can_scan.main(['can_scan', *bus, '--start', '--seconds', '1']) == 0
        out = capsys.readouterr().out
        assert '  insertion\n' in out
        assert 'node_id: [1, 2, 3, 4]\n' in out
        assert can_setup.main(['can_setup', *bus, '--joint', 'insertion']) == 0
        assert 'insertion, node 5: encoder' in capsys.readouterr().out
