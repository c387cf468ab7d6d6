# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A log of `candump -l`: its times, its channels, and a line that is none."""

from contextlib import nullcontext

import pytest
from spm_haptic_master.encoders.log_file import LogFile
from spm_haptic_master.exceptions import ReplayError, SettingError


@pytest.fixture
def log_of(tmp_path):
    """Return the log file with some lines."""

    def make(*lines, end='\n'):
        path = tmp_path / 'rig.log'
        path.write_text('\n'.join(lines) + end)
        return LogFile(str(path))

    return make


def line_at(seconds, identifier='181', channel='can0'):
    return f'({seconds}) {channel} {identifier}#00000000'


@pytest.mark.parametrize(
    ('times', 'words'),
    [
        (('0.000000', '4294967295.000000'), None),
        (('1.0', '4294967296.000000'), 'the stamp of frame 2 is 4.29497e.09 s; expected 0 to'),
        (('-1.0', '1.0'), 'the stamp of frame 1 is -1 s; expected 0 to 4294967296 s'),
        # Recorders may swap frames within a cycle of 1 ms.
        (('5.000000', '4.999100'), None),
        (
            ('5.000000', '4.998900'),
            'time runs backwards at frame 2, from 5.000000 s to 4.998900 s',
        ),
    ],
)
def test_a_time_is_one_of_a_ros_message_and_not_well_before_the_last(log_of, times, words):
    log = log_of(*map(line_at, times))
    refused = pytest.raises(ReplayError, match=words) if words else nullcontext()
    with refused:
        assert len(list(log.frames())) == len(times)


IDENTIFIERS = {(0x181, False), (0x18FF1234, True)}


@pytest.mark.parametrize(
    ('lines', 'wanted', 'channel'),
    [
        ([line_at(1.0)], 'can7', 'can0'),
        ([line_at(1.0), line_at(1.0, '123', 'can1')], 'can7', 'can0'),
        ([line_at(1.0), line_at(1.0, channel='can1')], 'can1', 'can1'),
        ([line_at(1.0), line_at(1.0, channel='can1')], 'can7', None),
        ([line_at(1.0, '18FF1234', 'can2')], 'can7', 'can2'),
        ([line_at(1.0, '123')], 'can7', ''),
        # The first 5000 frames show it: a second of four encoders at 1 kHz.
        ([*[line_at(1.0)] * 4999, line_at(1.0, channel='can1')], 'can7', None),
        ([*[line_at(1.0)] * 5000, line_at(1.0, channel='can1')], 'can7', 'can0'),
    ],
)
def test_the_channel_is_the_one_with_frames_of_the_encoders(log_of, lines, wanted, channel):
    log = log_of(*lines)
    refused = pytest.raises(SettingError, match='one of can0, can1: .* on each')
    with refused if channel is None else nullcontext():
        assert log.select_channel(IDENTIFIERS, wanted) == channel


EXPECTED = r'expected \(SECONDS\) CHANNEL ID#DATA, as `candump -l` writes it'


@pytest.mark.parametrize(
    ('line', 'end', 'words'),
    [
        # An odd number of digits; a line that is cut.
        ('(1.0) can0 181#012', '\n', f"line 2 is '.1.0. can0 181#012'; {EXPECTED}$"),
        ('(1.0) can0 18', '', f"line 2 is '.1.0. can0 18'; {EXPECTED}; it is the last line: `sed"),
        ('x' * 60, '\n', f"line 2 is '{'x' * 60}'; {EXPECTED}$"),
        ('x' * 61, '\n', f"line 2 is '{'x' * 60}' ...; {EXPECTED}$"),
    ],
)
def test_a_line_that_is_none_is_quoted(log_of, line, end, words):
    with pytest.raises(ReplayError, match=words):
        list(log_of(line_at(1.0), line, end=end).frames())


def test_a_log_is_read_again_and_again(log_of):
    log = log_of(line_at(1.0), line_at(2.0))
    for _ in range(2):
        assert [message.timestamp for message in log.frames()] == [1.0, 2.0]
