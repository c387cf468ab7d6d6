# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lines for rig.yaml of a DBC file, against cantools' own encoding of its signals."""

import sys

from encoder_frames import values
import pytest
from spm_haptic_master.encoders import decoder_factory
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.tools import can_scan

cantools = pytest.importorskip('cantools')

# Start bit, bits and byte order (1: little) of the position in each of four frames; scale, unit.
POSITIONS = (
    ('0|14@1+', 0.02197265625, 'deg'),
    ('7|12@0+', 0.087890625, 'deg'),
    ('12|17@1+', 4.793689962e-5, 'rad'),
    ('5|20@0-', 1.0, ''),
)
COUNTS = (16384, 4096, 131072, 1 << 20)


def write_dbc(tmp_path, frames=4):
    """Write a DBC file of frames with a position, a counter and a status."""
    lines = ['VERSION ""', 'NS_ :', 'BS_:', 'BU_: RIG']
    for number, (position, scale, unit) in enumerate(POSITIONS[:frames]):
        identifier = 0x120 + number if number != 3 else 0x98FF1234
        lines += [
            f'BO_ {identifier} Joint{number}: 8 RIG',
            f' SG_ Angle{number} : {position} ({scale},0) [0|0] "{unit}" RIG',
            f' SG_ AliveCounter{number} : 48|4@1+ (1,0) [0|15] "" RIG',
            f' SG_ SensorStatus{number} : 56|2@1+ (1,0) [0|3] "" RIG',
            '',
        ]
    lines += [f'VAL_ {0x120} SensorStatus0 1 "OK" 0 "Init" 3 "Error" ;', '']
    path = tmp_path / 'joints.dbc'
    path.write_text('\n'.join(lines))
    return path


def test_the_lines_decode_what_the_file_describes(tmp_path, capsys):
    path = write_dbc(tmp_path)
    assert can_scan.main(['can_scan', '--dbc', str(path)]) == 0
    out = capsys.readouterr().out
    rig = tmp_path / 'rig.yaml'
    rig.write_text(out)
    given = {
        name.replace('.', '__'): value
        for name, value in read_parameters(rig).items()
        if name.startswith(('encoders.', 'can.'))
    }
    layouts = decoder_factory.make_layouts(
        values(
            **given,
            encoders__zero_count=(0, 0, 0, 0),
            encoders__direction=(1, 1, 1, 1),
        )
    )
    database = cantools.database.load_file(path)
    for number, (layout, frame) in enumerate(zip(layouts, database.messages, strict=True)):
        assert (layout.can_id, layout.extended) == (frame.frame_id, frame.is_extended_frame)
        assert layout.counts_per_turn == COUNTS[number]
        for raw in (0, 1, 777, 4095):
            data = frame.encode(
                {
                    f'Angle{number}': raw,
                    f'AliveCounter{number}': 5,
                    f'SensorStatus{number}': 1 if number == 0 else 0,
                },
                scaling=False,
            )
            assert layout.counts(data) == raw
            assert layout.counter(data) == 5
            assert layout.healthy(data)
    assert '# Joint3: counts_per_turn is 2 to the number of bits: compare the data sheet' in out
    assert 'status_good: the file does not say which value of SensorStatus1 is good' in out


def test_fewer_frames_are_named(tmp_path, capsys):
    assert can_scan.main(['can_scan', '--dbc', str(write_dbc(tmp_path, 1))]) == 0
    assert '# frames with a position: 1, expected 4 to 6: complete' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (None, 'no such file; expected a DBC file'),
        ('BO_ nonsense', 'not a readable DBC file ('),
        (
            'BO_ 5 Torque: 8 RIG\n SG_ Current : 0|16@1+ (1,0) [0|0] "A" RIG\n',
            'no signal with a position in it (signals: Current); expected one of 8 bits',
        ),
    ],
)
def test_what_is_no_dbc_file_of_encoders_is_one_line(tmp_path, capsys, content, words):
    path = tmp_path / 'a.dbc'
    if content is not None:
        path.write_text(content)
    assert can_scan.main(['can_scan', '--dbc', str(path)]) == 1
    error = capsys.readouterr().err
    assert words in error
    assert str(path) in error
    assert error.count('\n') == 1


def test_without_cantools_one_line_says_what_to_install(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'cantools', None)
    assert can_scan.main(['can_scan', '--dbc', str(write_dbc(tmp_path))]) == 1
    error = capsys.readouterr().err
    assert error.startswith('can_scan: a DBC file needs cantools (sudo apt install python3-')
    assert error.count('\n') == 1
