# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The settings of an encoder from the signals of a DBC file, without the library cantools.

The stand-ins have the attributes of cantools' messages and signals that are read.
"""

import sys
from types import ModuleType, SimpleNamespace
from unittest.mock import Mock

import pytest
from spm_haptic_master.encoders.dbc_file import read_dbc, rig_lines
from spm_haptic_master.exceptions import InputError


def signal_of(name, **fields):
    """Return a signal: a little-endian word of 16 bits without a scale or unit."""
    fields = {
        'start': 0,
        'length': 16,
        'byte_order': 'little_endian',
        'is_signed': False,
        'is_float': False,
        'scale': 1,
        'offset': 0,
        'maximum': None,
        'unit': None,
        'choices': None,
        **fields,
    }
    return SimpleNamespace(name=name, **fields)


def frame_of(*signals, **fields):
    """Return a message with signals."""
    fields = {
        'name': 'Joint',
        'frame_id': 0x120,
        'is_extended_frame': False,
        'length': 8,
        **fields,
    }
    return SimpleNamespace(signals=list(signals), **fields)


@pytest.fixture
def described(tmp_path, monkeypatch):
    """Return the frames that are described by a file with these messages."""

    def reading(*frames):
        library = ModuleType('cantools')
        database = SimpleNamespace(messages=list(frames))
        library.database = SimpleNamespace(load_file=lambda path: database)
        monkeypatch.setitem(sys.modules, 'cantools', library)
        path = tmp_path / 'joints.dbc'
        path.touch()
        return read_dbc(str(path))

    return reading


FROM_BITS = 'counts_per_turn is 2 to the number of bits: compare the data sheet'
FROM_MAXIMUM = 'counts_per_turn is from the maximum: compare the data sheet'


def test_identifier_length_and_names_are_those_of_the_message(described):
    (frame,) = described(
        frame_of(
            signal_of('Angle', is_signed=True),
            name='Elbow',
            frame_id=0x18FF1234,
            is_extended_frame=True,
            length=6,
        )
    )
    assert (frame.name, frame.signal) == ('Elbow', 'Angle')
    assert (frame.can_id, frame.extended) == (0x18FF1234, True)
    assert frame.data_length == 6
    assert frame.signed
    # No rolling counter, no status bits.
    assert (frame.counter_byte, frame.counter_mask) == (0, 0)
    assert (frame.status_byte, frame.status_mask, frame.status_good) == (0, 0, 0)


@pytest.mark.parametrize(
    ('start', 'length', 'byte_order', 'word'),
    [
        # First byte, bits and mask of the word; a mask of 0 is all bits.
        (0, 16, 'little_endian', (0, 16, 0)),
        (0, 14, 'little_endian', (0, 16, 0x3FFF)),
        (2, 14, 'little_endian', (0, 16, 0xFFFC)),
        (12, 17, 'little_endian', (1, 24, 0x1FFFF0)),
        (24, 8, 'little_endian', (3, 8, 0)),
        (7, 16, 'big_endian', (0, 16, 0)),
        (7, 12, 'big_endian', (0, 16, 0xFFF0)),
        (13, 20, 'big_endian', (1, 24, 0x3FFFFC)),
        (23, 8, 'big_endian', (2, 8, 0)),
    ],
)
def test_a_signal_is_in_whole_bytes_with_a_mask(described, start, length, byte_order, word):
    position = signal_of('Position', start=start, length=length, byte_order=byte_order)
    (frame,) = described(frame_of(position))
    assert (frame.byte_offset, frame.bit_length, frame.mask) == word
    assert frame.byte_order == byte_order.removesuffix('_endian')


@pytest.mark.parametrize(
    ('fields', 'counts', 'remarks'),
    [
        ({'unit': 'deg', 'scale': 360.0 / 4096}, 4096, ()),
        ({'unit': ' Degrees ', 'scale': -360.0 / 4096}, 4096, ()),
        ({'unit': '°', 'scale': 0.1}, 3600, ()),
        ({'unit': 'degree', 'scale': 0.1}, 3600, ()),
        ({'unit': 'mdeg', 'scale': 10.0}, 36000, ()),
        ({'unit': 'rad', 'scale': 9.58738e-05}, 65536, ()),
        ({'unit': 'mrad', 'scale': 0.0958738}, 65536, ()),
        ({'unit': 'turn', 'scale': 0.001}, 1000, ()),
        ({'unit': 'turns', 'scale': 0.001}, 1000, ()),
        ({'unit': 'rev', 'scale': 0.001}, 1000, ()),
        # 100.09 counts are 100 with a rounded scale, 100.15 and 200.3 are not.
        ({'unit': 'rev', 'scale': 1.0 / 100.09}, 100, ()),
        ({'unit': 'rev', 'scale': 1.0 / 100.15}, 65536, (FROM_BITS,)),
        ({'unit': 'rev', 'scale': 1.0 / 99.85}, 65536, (FROM_BITS,)),
        ({'unit': 'rev', 'scale': 0}, 65536, (FROM_BITS,)),
        ({'unit': 'A', 'scale': 0.1}, 65536, (FROM_BITS,)),
        ({'length': 12}, 4096, (FROM_BITS,)),
        ({'maximum': 3599}, 3600, (FROM_MAXIMUM,)),
        ({'maximum': 359.9, 'scale': 0.1}, 3600, (FROM_MAXIMUM,)),
        ({'maximum': 1799.5, 'scale': 0.5, 'offset': -200.0}, 4000, (FROM_MAXIMUM,)),
        ({'maximum': 2}, 3, (FROM_MAXIMUM,)),
        ({'maximum': 1}, 65536, (FROM_BITS,)),
        ({'maximum': 0}, 65536, (FROM_BITS,)),
        ({'maximum': 3599, 'is_signed': True}, 65536, (FROM_BITS,)),
        # No turn has more counts than the signal can hold.
        ({'unit': 'deg', 'scale': 1e-320}, 65536, (FROM_BITS,)),
        ({'maximum': float('inf')}, 65536, (FROM_BITS,)),
        ({'maximum': 3599, 'scale': 0}, 65536, (FROM_BITS,)),
        ({'maximum': 70000}, 65536, (FROM_BITS,)),
    ],
)
def test_counts_per_turn_are_by_the_scale_the_maximum_or_the_bits(
    described, fields, counts, remarks
):
    (frame,) = described(frame_of(signal_of('Position', **fields)))
    assert (frame.counts_per_turn, frame.remarks) == (counts, remarks)


@pytest.mark.parametrize(
    ('signals', 'chosen'),
    [
        # The longest of them; 8 bits are the least.
        ([signal_of('Pos1', length=8), signal_of('Pos2', length=9)], 'Pos2'),
        ([signal_of('Current', length=32), signal_of('Winkel', length=8)], 'Winkel'),
        ([signal_of('Position', is_float=True), signal_of('EncoderCount', length=12)], None),
        ([signal_of('AliveCounter', length=16), signal_of('RawCount', length=10)], 'RawCount'),
    ],
)
def test_the_position_is_the_longest_signal_with_such_a_name(described, signals, chosen):
    (frame,) = described(frame_of(*signals))
    assert frame.signal == (chosen or 'EncoderCount')


@pytest.mark.parametrize(
    ('signals', 'words'),
    [
        ([], 'signals: none'),
        ([signal_of('Angle', length=7)], 'signals: Angle'),
        ([signal_of('Angle', is_float=True), signal_of('Torque')], 'signals: Angle, Torque'),
    ],
)
def test_a_file_without_a_position_is_refused(described, signals, words):
    with pytest.raises(InputError, match=f'no signal with a position in it .{words}'):
        described(frame_of(*signals))


def test_a_file_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(InputError, match='joints.dbc: no such file; expected a DBC file'):
        read_dbc(str(tmp_path / 'joints.dbc'))


def test_without_the_library_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'cantools', None)
    path = tmp_path / 'joints.dbc'
    path.touch()
    with pytest.raises(InputError, match='a DBC file needs cantools'):
        read_dbc(str(path))


def test_the_reason_of_the_library_is_one_short_line(tmp_path, monkeypatch):
    library = ModuleType('cantools')
    library.database = Mock()
    library.database.load_file.side_effect = ValueError('line 1:\n  bad' + 300 * '.')
    monkeypatch.setitem(sys.modules, 'cantools', library)
    path = tmp_path / 'joints.dbc'
    path.touch()
    reason = 'line 1: bad' + 189 * '.'
    with pytest.raises(InputError) as refused:
        read_dbc(str(path))
    assert str(refused.value) == f'{path}: not a readable DBC file ({reason})'


def test_a_frame_without_a_position_is_left_out(described):
    found = described(
        frame_of(signal_of('Torque')),
        frame_of(signal_of('Angle'), name='Wrist'),
    )
    assert [frame.name for frame in found] == ['Wrist']


@pytest.mark.parametrize(
    ('fields', 'byte', 'mask', 'remarks'),
    [
        ({'start': 48, 'length': 4}, 6, 0x0F, ()),
        ({'start': 52, 'length': 4}, 6, 0xF0, ()),
        ({'start': 48, 'length': 8}, 6, 0xFF, ()),
        ({'start': 48, 'length': 9}, 0, 0, ('Rolling is in more than one byte, and not used',)),
    ],
)
def test_the_rolling_counter_is_in_one_byte(described, fields, byte, mask, remarks):
    angle = signal_of('Angle', unit='rev', scale=1.0 / 4096)
    (frame,) = described(frame_of(angle, signal_of('Rolling', **fields)))
    assert (frame.counter_byte, frame.counter_mask) == (byte, mask)
    assert frame.remarks == remarks


NO_GOOD_VALUE = 'status_good: the file does not say which value of State is good'


@pytest.mark.parametrize(
    ('fields', 'byte', 'mask', 'good', 'remarks'),
    [
        ({'choices': {0: 'Init', 2: 'OK'}}, 7, 0x30, 0x20, ()),
        ({'choices': {1: 'No error'}}, 7, 0x30, 0x10, ()),
        ({'choices': {1: 'NOK'}}, 7, 0x30, 0, (NO_GOOD_VALUE,)),
        ({}, 7, 0x30, 0, (NO_GOOD_VALUE,)),
        ({'length': 5}, 0, 0, 0, ('State is in more than one byte, and not used',)),
    ],
)
def test_the_good_status_is_at_its_place_in_the_byte(described, fields, byte, mask, good, remarks):
    angle = signal_of('Angle', unit='rev', scale=1.0 / 4096)
    status = signal_of('State', **{'start': 60, 'length': 2, **fields})
    (frame,) = described(frame_of(angle, status))
    assert (frame.status_byte, frame.status_mask, frame.status_good) == (byte, mask, good)
    assert frame.remarks == remarks


def test_a_signal_has_one_meaning(described):
    angle = signal_of('AngleStatus', unit='rev', scale=1.0 / 4096)
    counter = signal_of('StatusCounter', start=56, length=4)
    (frame,) = described(frame_of(angle, counter))
    assert frame.signal == 'AngleStatus'
    assert (frame.counter_byte, frame.counter_mask) == (7, 0x0F)
    assert frame.status_mask == 0


JOINTS_EXPECTED = ', expected 4 to 6: complete or shorten the lists'


@pytest.mark.parametrize(
    ('count', 'words', 'sensors'),
    [
        (3, f'# frames with a position: 3{JOINTS_EXPECTED}', None),
        (4, None, None),
        (5, None, '    sensors: 5'),
        (6, None, '    sensors: 6'),
        (7, f'# frames with a position: 7{JOINTS_EXPECTED}', None),
    ],
)
def test_the_lines_have_the_number_of_sensors(described, count, words, sensors):
    frames = [frame_of(signal_of('Angle'), frame_id=0x120 + each) for each in range(count)]
    lines = rig_lines(described(*frames), 'joints.dbc')
    assert [line for line in lines if 'expected' in line] == ([words] if words else [])
    assert [line for line in lines if 'sensors' in line] == ([sensors] if sensors else [])


def test_the_lines_are_yaml_in_the_units_of_a_rig(described):
    found = described(
        frame_of(
            signal_of('Angle', length=14, unit='deg', scale=360.0 / 16384),
            signal_of('Alive', start=20, length=4),
            name='A',
        ),
        frame_of(signal_of('Angle', is_signed=True), name='B', frame_id=0x1ABCD, length=4),
    )
    assert rig_lines(found, 'joints.dbc')[2:] == [
        '/**:',
        '  ros__parameters:',
        '    source: can',
        '    can: {protocol: raw}   # delete it if they are CANopen nodes',
        '    encoders:',
        '      # A.Angle, B.Angle',
        '      id: [0x120, 0x1ABCD]',
        '      extended: [false, false]',
        '      data_length: [8, 4]',
        '      byte_offset: [0, 0]',
        '      bit_length: [16, 16]',
        '      byte_order: [little, little]',
        '      mask: [0x3FFF, 0x0]',
        '      signed: [false, true]',
        '      counts_per_turn: [16384, 65536]',
        '      counter_byte: [2, 0]',
        '      counter_mask: [0xF0, 0x0]',
        '      status_byte: [0, 0]',
        '      status_mask: [0x0, 0x0]',
        '      status_good: [0, 0]',
        f'# B: {FROM_BITS}',
    ]
