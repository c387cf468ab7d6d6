# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readers of recordings, given what is none: sets that are right, or one line that says where."""

from contextlib import closing
import csv
import gzip
from math import isfinite
import random
import re

from encoder_frames import record, stream, values
import numpy as np
import pytest
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.simulation.source_factory import make_replay
from spm_haptic_master.tools.calibrate import main
from spm_haptic_master.validation import recordings

FORMATS = ('.log', '.asc', '.csv', '.trc', '.blf', '.log.gz', '.asc.gz', '.csv.gz', '.trc.gz')
TABLES = ('.csv', '.csv.gz')
READERS = (recordings.read_orientation, recordings.read_joints, recordings.read_capture)
NUMBER = re.compile(rb'\d+(\.\d+)?')
WRONG = (b'nan', b'-nan', b'inf', b'1e999', b'-1', b'9' * 300, b'1e18', b'', b'0x', b'\xff')
# A cycle of the encoders, as candump writes it.
CYCLE = ('080#', '181#00000000', '182#00000000', '183#00000000', '184#00000000')


def noise(data, rng):
    return rng.randbytes(rng.randrange(1, 5000))


def cut(data, rng):
    return data[: rng.randrange(len(data))]


def spoilt(data, rng):
    found = bytearray(data)
    for _ in range(rng.randrange(1, 20)):
        found[rng.randrange(len(found))] = rng.randrange(256)
    return bytes(found)


def numbers(data, rng):
    """Put something else in place of some numbers."""
    places = rng.sample([*NUMBER.finditer(data)], 3)
    for place in sorted(places, key=lambda each: -each.start()):
        data = data[: place.start()] + rng.choice(WRONG) + data[place.end() :]
    return data


def columns(data, rng):
    """Turn the columns of each line round, or leave one out."""
    lines = [re.split(rb'([ ,]+)', line) for line in data.split(b'\n')]
    return b'\n'.join(b''.join(line[::-1] if rng.random() < 0.5 else line[2:]) for line in lines)


DAMAGES = (noise, cut, spoilt, numbers, columns)


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """Return the content of a recording of each kind and format, by the end of its name."""
    directory = tmp_path_factory.mktemp('whole')
    for suffix in FORMATS:
        record(directory / f'log{suffix}', stream(*range(60)))
    for suffix, opened in zip(TABLES, (open, gzip.open), strict=True):
        with opened(directory / f'table{suffix}', 'wt', newline='') as file:
            writer = csv.writer(file)
            writer.writerow(('time', *recordings.QUATERNION, *recordings.JOINT_NAMES))
            for row in range(50):
                writer.writerow([0.01 * row, 0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3, 0.4])
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def read_log(path, _):
    with closing(make_replay(values('replay', replay__path=str(path)))) as source:
        for sample in source.recorded():
            assert 0 <= sample.stamp < 2**63
            assert all(map(isfinite, sample.angles))


@pytest.mark.parametrize('damage', DAMAGES)
@pytest.mark.parametrize(
    ('name', 'read'),
    [
        *((f'log{suffix}', read_log) for suffix in FORMATS),
        *((f'table{suffix}', read) for suffix in TABLES for read in READERS),
    ],
)
def test_a_damaged_recording_gives_what_is_in_it_or_one_line(tmp_path, whole, name, read, damage):
    path = tmp_path / name
    data = whole[name]
    rng = random.Random(f'{name} {damage.__name__} 0')
    if name.endswith('.gz') and damage in (numbers, columns):
        # Of a compressed text, what is in it.
        path.write_bytes(gzip.compress(damage(gzip.decompress(data), rng)))
    else:
        path.write_bytes(damage(data, rng))
    try:
        track = read(path, '/topic')
        assert track is None or np.isfinite(track.time).all()
    except SpmError as error:
        # Where, and what was expected.
        text = str(error)
        assert str(path) in text
        assert '\n' not in text
        assert len(text) < len(str(path)) + 600
        assert not re.search(r'Traceback|[a-z]Error\b|codec|unpack', text), text


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    (
        ('a.log', b'\x89\xff\x00', "line 1 is '\\\\x89\\\\xff\\x00'; expected (SECONDS) CHANNEL"),
        ('a.log', b'(1.0) can0 080#\n\nhello\n', "line 3 is 'hello'; expected (SECONDS) CHANNEL"),
        (
            'a.csv',
            b'time,joint_1a\n1.0,2.0\n',
            "line 2 is '1.0,2.0'; expected timestamp,arbitration",
        ),
        (
            'a.log.gz',
            gzip.compress(b'(1.0) can0 080#\n' * 99, mtime=0)[:40],
            'expected a whole .gz file',
        ),
        ('a.blf', b'hello', 'expected a whole Vector BLF file'),
        ('a.log', b'', 'no set of four encoders in it; its frames: none'),
        (
            'a.log',
            b''.join(
                b'(%.3f) can0 18%d#00000000\n' % (0.001 * number + 1e-5 * node, node)
                for number in range(9)
                for node in (1, 2, 3, 4)
            ),
            'the encoders send without SYNC: give -p encoders.sync_id:=0',
        ),
        *(
            ('a.log', ''.join(f'({stamp}) can0 {frame}\n' for frame in CYCLE).encode() * 90, words)
            for stamp, words in (
                ('nan', 'the stamp of frame 1 is nan s; expected 0 to 4294967296 s'),
                ('inf', 'the stamp of frame 1 is inf s'),
                ('-1', 'the stamp of frame 1 is -1 s'),
                ('0', 'has no times: its first 3 sets all have the stamp 0 s'),
            )
        ),
    ),
)
def test_calibrate_reports_where_a_file_is_not_a_log(tmp_path, capsys, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    # Times are needed by a replay, as of a jig's pose.
    kind = () if 'no times' in words else ('--motion',)
    assert (
        main(
            [
                'calibrate',
                *kind,
                '-o',
                str(tmp_path / 'c.yaml'),
                '-p',
                'source:=replay',
                '-p',
                f'replay.path:={path}',
            ]
        )
        == 1
    )
    *_, line = capsys.readouterr().err.splitlines()
    assert line.startswith(f'calibrate: {path}')
    assert words in line
    assert not (tmp_path / 'c.yaml').exists()
