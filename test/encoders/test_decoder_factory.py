# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings that cannot be are refused in a line: the name, the value, what is allowed."""

from encoder_frames import decoder, values
import pytest
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.simulation.source_factory import make_source


def test_an_interface_that_python_can_does_not_have_is_refused():
    with pytest.raises(SettingError, match="'can.interface' is 'nonsense'; expected one of"):
        make_source('can', values(can__interface='nonsense'))


COUNTER, STATUS = {'counter_mask': 0xF0}, {'status_mask': 0b101}


# Values of one encoder, or (None) of all settings, at the edge of what the others allow: index,
# settings, and the error if they are refused.
@pytest.mark.parametrize(('index', 'changes', 'expected'), [
    (2, {'id': 0x182}, "'encoders.id' .* four different identifiers; joint_1b and joint_1c both "
     'have 0x182'),
    (2, {'id': 0x7FF}, None), (2, {'id': 0x800, 'extended': True}, None),
    (2, {'id': 0x800}, "'encoders.id' .* 11-bit identifier for joint_1c"),
    (2, {'id': 0x702}, "'encoders.id' .* for joint_1c .*0x702: heartbeat of node 2"),
    (3, {'id': 0x100}, '0x100: TIME'), (2, {'id': 0x80, 'extended': True}, None),
    (2, {'node_id': 2}, "'encoders.node_id' .* four different node ids"),
    (2, {'zero_count': 16384}, "'encoders.zero_count' .* below the 16384"),
    (1, {'byte_offset': 4, 'data_length': 8}, None),
    (1, {'byte_offset': 5, 'data_length': 8},
     "'encoders.byte_offset' .* a word of 32 bits that ends within the 8 bytes"),
    (2, {'mask': 0b1011}, "'encoders.mask' .* contiguous bits, for joint_1c"),
    (1, {'mask': 0xFFFFFFFF}, None), (1, {'mask': 0x0FFFC0}, None),
    (1, {'mask': 0x1FFFFFFFF}, "'encoders.mask' .* bits within the 32"),
    (1, {'mask': 0x1FFF}, "'encoders.counts_per_turn' .* 13 bits can hold"),
    (1, {'mask': 0x7FFF, 'counts_per_turn': 16385}, None),
    (1, {'mask': 0x7FFF},
     "'encoders.counts_per_turn' .* more than 16384, as .* selects 15 bits, for joint_1b"),
    (1, {'bit_length': 20}, "'encoders.counts_per_turn' .* selects 20 bits"),
    (1, {**COUNTER, 'counter_byte': 4}, "'encoders.counter_byte' .* joint_1b"),
    (1, {**COUNTER, 'counter_byte': 3, 'bit_length': 24}, None),
    (1, {**COUNTER, 'counter_byte': 3},
     "'encoders.counter_mask' .* bits that are not the counts, for joint_1b"),
    (1, {'mask': 0x3FFF, 'counter_mask': 0x40, 'counter_byte': 1}, None),
    (1, {'mask': 0x3FFF, 'counter_mask': 0x20, 'counter_byte': 1},
     "'encoders.counter_mask' .* not the counts"),
    (1, {'counter_mask': 0b1010}, "'encoders.counter_mask' .* contiguous bits"),
    (1, {'mask': 0x3FFF, 'byte_order': 'big', 'status_mask': 0xC0, 'status_byte': 2}, None),
    (1, {'mask': 0x3FFF, 'byte_order': 'big', 'status_mask': 0x01, 'status_byte': 3},
     "'encoders.status_mask' .* bits that are not the counts"),
    (1, {'counter_mask': 0x0F, 'counter_byte': 3, 'status_mask': 0x18, 'status_byte': 3,
         'bit_length': 24}, "'encoders.status_mask' .* bits that are not the counter"),
    (3, {**STATUS, 'status_byte': 3, 'status_good': 0b100, 'bit_length': 24}, None),
    (3, {**STATUS, 'status_byte': 4},
     "'encoders.status_byte' .* a byte within the 4 bytes .* joint_3a"),
    (3, {**STATUS, 'status_byte': 3, 'status_good': 0b111, 'bit_length': 24},
     "'encoders.status_good'"),
    (None, {'sensors': 6, 'encoders__id': (0x181, 0x182, 0x183, 0x184, 0x185, 0x181)},
     'six different identifiers; joint_1a and joint_3c'),
    (None, {'encoders__id': (0x181, 0x182, 0x80, 0x184), 'can__protocol': 'raw'},
     "'encoders.sync_id' is 128.*joint_1c has it"),
    (None, {'encoders__sync_id': 0x701}, "'encoders.sync_id' .*0x701: heartbeat of node 1"),
    (None, {'encoders__sync_id': 0x99, 'can__protocol': 'raw'}, None),
    (None, {'encoders__id': (0x80, 0x182, 0x183, 0x184), 'encoders__sync_id': 0}, '0x80: SYNC'),
    (None, {'encoders__id': (0x180, 0x57F, 0x681, 0x6FF)}, None),
    (None, {'encoders__id': (0x5FF, 0x601, 0x77F, 0x100), 'can__protocol': 'raw'}, None),
    (None, {'encoders__window': 0.003}, None),
    (None, {'encoders__window': 0.0031}, "'encoders.window' is 0.0031; .* 3 periods, 0.003 s"),
    (None, {'encoders__window': 0.009, 'rate': 333.33333}, None),
    (None, {'encoders__window': 1e-6}, "'encoders.window' is 1e-06; .* from 1e-05 s"),
])
def test_settings_are_checked_against_each_other(index, changes, expected):
    overrides = dict(changes)
    if index is not None:
        overrides = {}
        for name, value in changes.items():
            each = list(values()[f'encoders.{name}'])
            each[index] = value
            overrides[f'encoders__{name}'] = tuple(each)
    if expected is None:
        decoder(**overrides)
        return
    with pytest.raises(SettingError, match=expected):
        decoder(**overrides)


@pytest.mark.parametrize(('bitrate', 'rate', 'overrides', 'words'), [
    (250_000, 545.0, {}, None), (0, 9000.0, {}, None),
    # 435 bits at 950 Hz are exactly 95 %.
    (435_000, 950.0, {}, None),
    (250_000, 600.0, {}, "parameter 'rate' is 600.0; expected at most 546 Hz at can.bitrate "
     '250000: a cycle of SYNC and four answers has up to 435 bits, and 435 bits x 600 Hz / 250000 '
     'bit/s = 104 % bus load, beyond 95 %'),
    (250_000, 1000.0, {'encoders__sync_id': 0}, 'a cycle of four answers has up to 380 bits'),
    (1_000_000, 1600.0, {'sensors': 6}, 'SYNC and six answers'),
    # Stuffed: 135 bits for a frame of eight bytes, 160 with 29 bits (CAN in Automation).
    (500_000, 1000.0, {'encoders__data_length': (8,) * 4,
                       'encoders__extended': (False, True, False, False)}, 'up to 620 bits')])
def test_a_rate_that_the_bus_cannot_carry_is_refused_with_the_arithmetic(
        bitrate, rate, overrides, words):
    settings = values(can__interface='virtual', can__bitrate=bitrate, rate=rate, **overrides)
    if words is None:
        make_source('can', settings).close()
        return
    with pytest.raises(SettingError) as error:
        make_source('can', settings)
    assert words in str(error.value)


@pytest.mark.parametrize(('source', 'given'), [
    ('can', {}), ('replay', {'replay__path': '/data/session.log'})])
def test_what_decodes_counts_needs_verified_directions(source, given):
    assert unverified_joints(values(source, **given)) == unverified_joints(values('sim')) == ()
    some = {**given, 'encoders__direction_verified': (True, False, True, False)}
    with pytest.raises(SettingError, match='direction of joint_1b, joint_3a is not verified'):
        unverified_joints(values(source, **some))
    assert unverified_joints(values(
        source, **some, encoders__accept_unverified_directions=True)) == ('joint_1b', 'joint_3a')
