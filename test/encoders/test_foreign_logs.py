# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Logs as other tools write them: what is right in them is used, what is not is named."""

from contextlib import closing
import gzip
import re
import shutil

import can
from encoder_frames import record, stream, T0, values
import pytest
from spm_haptic_master.exceptions import ReplayError, SettingError
from spm_haptic_master.simulation.source_factory import make_replay


def replayed(path, **overrides):
    """Return the sets of a recording, with their recorded stamps."""
    with closing(make_replay(values('replay', replay__path=str(path), **overrides))) as source:
        return [*source.recorded()]


def two_buses():
    """Return the frames of a rig, and of another one whose angles are 0, on a second channel."""
    frames = stream(*range(60))
    others = stream(*range(60))
    for own, other in zip(frames, others, strict=True):
        own.channel = 0
        other.channel = 1
        other.timestamp += 2e-5
        if 0x181 <= other.arbitration_id <= 0x184:
            other.data = bytes(len(other.data))
    return sorted([*frames, *others], key=lambda message: message.timestamp)


@pytest.mark.parametrize(
    ('suffix', 'first', 'second'),
    [
        ('.asc', '1', '2'),
        ('.blf', '1', '2'),
        ('.trc', '1', '2'),
    ],
)
def test_L1_of_a_log_of_two_buses_the_channel_selects_the_rig(tmp_path, suffix, first, second):
    path = record(tmp_path / f'two{suffix}', two_buses())
    own, other = (replayed(path, can__channel=channel) for channel in (first, second))
    assert len(own) == len(other) == 60
    assert own[7].angles == pytest.approx((0.1, 0.2, 0.3, 0.4), abs=4e-4)
    assert other[7].angles != pytest.approx(own[7].angles, abs=0.01)
    for channel in ('any', 'can0'):
        with pytest.raises(
            SettingError,
            match=rf"'can.channel' is '{channel}'; expected one of 1, 2: .* has frames of the "
            'encoders on each',
        ):
            replayed(path, can__channel=channel)


def test_L1_of_candump_any_the_channel_selects_and_an_emergency_elsewhere_is_not_ours(tmp_path):
    frames = stream(*range(60))
    for message in frames:
        message.channel = 'can0'
    foreign = [
        can.Message(
            arbitration_id=0x081,
            data=b'\x00\x50\x10\0\0\0\0\0',
            is_extended_id=False,
            timestamp=T0 + 0.02,
            channel='can1',
        )
    ]
    path = tmp_path / 'any.log'
    with can.CanutilsLogWriter(path) as writer:
        for message in sorted([*frames, *foreign], key=lambda message: message.timestamp):
            writer.on_message_received(message)
    # One channel alone has encoders: it needs no name, and the one of another log does not matter.
    for channel in ('any', 'can0', 'vcan7'):
        assert len(replayed(path, can__channel=channel)) == 60


def test_L2_relative_times_of_a_vector_log_are_added_up(tmp_path):
    """Also those of lines that are no frames."""
    frames = stream(*range(200))
    path = record(tmp_path / 'absolute.asc', frames)
    lines = []
    last = 0.0
    for line in path.read_text().splitlines():
        found = re.match(r'\s*(\d+\.\d+)(\s.*)', line)
        if found:
            line = f'{float(found[1]) - last:.6f}{found[2]}'
            last = float(found[1])
        lines.append(line.replace('timestamps absolute', 'timestamps relative'))
        if found and len(lines) % 50 == 0:
            lines.append('0.000500 1  Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%')
    relative = tmp_path / 'relative.asc'
    relative.write_text('\n'.join(lines) + '\n')
    assert 'timestamps relative' in relative.read_text()
    expected = replayed(path)
    sets = replayed(relative)
    assert len(sets) == len(expected) == 200
    spans = [each[-1].stamp - each[0].stamp for each in (expected, sets)]
    assert spans[0] == pytest.approx(199e6, rel=1e-3)
    # Twenty lines of statistics came half a millisecond after a frame each.
    assert spans[1] - spans[0] == pytest.approx(5e5 * ((len(lines) - 5) // 51), rel=0.1)


@pytest.mark.parametrize('resolution', [1e-3, 15.6e-3])
def test_L2_times_that_are_too_coarse_for_the_sets_are_named(tmp_path, resolution):
    frames = stream(*(number * 0.75 for number in range(400)))
    for message in frames:
        message.timestamp = T0 + (message.timestamp - T0) // resolution * resolution
    with pytest.raises(ReplayError, match=r'coarse.log: its times are too coarse: .*0\.1 ms or f'):
        replayed(record(tmp_path / 'coarse.log', frames))


def killed(path, frames):
    """Write a .blf as python-can's writer leaves it on disk if its process is killed."""
    writer = can.BLFWriter(path.with_suffix('.open'))
    for message in frames:
        writer.on_message_received(message)
    writer._flush()
    writer.file.flush()
    shutil.copy(path.with_suffix('.open'), path)
    writer.stop()
    return path


def test_L4_a_blf_whose_recorder_was_killed_is_not_taken_for_a_whole_one(tmp_path):
    path = killed(tmp_path / 'a.blf', stream(*range(50)))
    with pytest.raises(
        ReplayError,
        match=r'a\.blf: its recording was not ended \(.*`can_logconvert a\.blf whole\.blf` keeps '
        'the 250 frames',
    ):
        replayed(path)


def test_L4_damaged_bytes_and_half_a_blf_are_named_for_what_they_are(tmp_path):
    path = record(tmp_path / 'a.blf', stream(*range(3000)))
    content = path.read_bytes()
    damaged = bytearray(content)
    damaged[len(content) // 2 : len(content) // 2 + 40] = bytes(40)
    path.write_bytes(damaged)
    with pytest.raises(ReplayError, match='its data are damaged; expected a whole Vector BLF'):
        replayed(path)
    # A whole .gz of half a .blf.
    half = tmp_path / 'half.blf.gz'
    half.write_bytes(gzip.compress(content[: len(content) // 2]))
    with pytest.raises(ReplayError, match=r'half\.blf\.gz: not readable after \d+ frames: .*'):
        replayed(half)


@pytest.mark.parametrize('frame', ['181#0510000', '181#05100', '181##', '181#0G'])
def test_L4_a_line_that_lost_a_digit_is_no_frame(tmp_path, frame):
    path = record(tmp_path / 'a.log', stream(*range(20)))
    lines = path.read_text().splitlines(keepends=True)
    lines.insert(50, f'(1760000000.5) can0 {frame}\n')
    path.write_text(''.join(lines))
    with pytest.raises(ReplayError, match=f"line 51 is '.* can0 {frame}'; expected .SECONDS"):
        replayed(path)


def test_L4_a_cut_last_line_says_how_to_remove_it(tmp_path):
    path = record(tmp_path / 'a.log', stream(*range(20)))
    path.write_text(path.read_text()[:-4])
    with pytest.raises(ReplayError, match='it is the last line: `sed -i "\\$ d" a.log` removes'):
        replayed(path)


@pytest.mark.parametrize(
    'line', ['181#', '181#R', '181#R4', '00000181#0102', '181##10102', '20000080#0000000000000000']
)
def test_lines_of_every_kind_of_frame_are_read(tmp_path, line):
    path = record(tmp_path / 'a.log', stream(*range(20)))
    with open(path, 'a', encoding='ascii') as file:
        file.write(f'({T0 + 1.0:.6f}) vcan0 {line} R\n\n')
    assert len(replayed(path)) == 20


def test_L5_a_clock_that_was_set_forward_is_no_hour_of_waiting(tmp_path, clock):
    frames = [*stream(*range(20))]
    for message in stream(*range(30, 50)):
        message.timestamp += 3600.0
        frames.append(message)
    path = record(tmp_path / 'a.log', frames)
    source = make_replay(values('replay', replay__path=str(path)))
    begin = clock.now
    said = set()
    for _ in range(60):
        try:
            source.read(1.0)
        except Exception:  # noqa: B902 - its end
            break
        said.add(source.fault)
    assert 'a gap of 3600.0 s in the recording, 0.0 s after its beginning' in said
    assert 4.0 < clock.now - begin < 7.0
