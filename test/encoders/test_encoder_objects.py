# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which values the objects of an encoder are to have, and which of them need not."""

from contextlib import nullcontext
from dataclasses import replace

from encoder_frames import LAYOUTS
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_objects import EncoderRules, milliseconds, wanted_objects
from spm_haptic_master.exceptions import InputError

# The encoder of joint_1b, node 2, with 16384 counts per turn.
LAYOUT = LAYOUTS[1]
RULES = EncoderRules(counts_per_turn=16384, timer=0, event_timer=(0x1800, 5))


def of(objects):
    """Return the function that returns the value of an object by index and subindex."""
    return lambda index, subindex: objects.get((index, subindex))


@pytest.mark.parametrize(
    ('seconds', 'expected'),
    [
        (0.001, 1),
        (0.1, 100),
        (65.535, 65535),
        (0.0009, None),
        (0.0, None),
        (65.536, None),
        (0.0015, None),
        (-0.1, None),
        # Written with six digits, and with four.
        (0.1 * (1.0 + 0.9e-6), 100),
        (0.1 * (1.0 + 1.1e-6), None),
    ],
)
def test_a_time_is_in_whole_milliseconds_of_sixteen_bits(seconds, expected):
    refused = pytest.raises(InputError, match='expected whole milliseconds, 0.001 to 65.535 s')
    with refused if expected is None else nullcontext():
        assert milliseconds('--heartbeat', seconds) == expected


DISC = canopen.DISC_UNITS_PER_TURN
UNITS = canopen.UNITS_PER_TURN
SCALING = canopen.OPERATING_PARAMETERS
RANGE = canopen.TOTAL_RANGE
TIMER = canopen.CYCLIC_TIMER


@pytest.mark.parametrize(
    ('objects', 'resolution'),
    [
        ({}, None),
        ({DISC: 4096}, 4096),
        ({UNITS: 16384}, 16384),
        ({UNITS: 16384, DISC: 4096}, 16384),
        # Bit 2 of 0x6000 switches the scaling.
        ({SCALING: 4, UNITS: 16384, DISC: 4096}, 16384),
        ({SCALING: 0xB, UNITS: 16384, DISC: 4096}, 4096),
        ({SCALING: 0, UNITS: 16384}, None),
    ],
)
def test_the_resolution_is_scaled_or_that_of_the_disc(objects, resolution):
    assert RULES.resolution(of(objects)) == resolution


@pytest.mark.parametrize(
    ('objects', 'excused'),
    [
        # Nothing to scale; scaled as wanted; the disc as wanted; neither.
        ({DISC: 16384}, {SCALING, UNITS}),
        ({SCALING: 4, UNITS: 16384, DISC: 65536}, {DISC, SCALING, UNITS}),
        ({SCALING: 0, UNITS: 7, DISC: 16384}, {DISC, SCALING, UNITS, RANGE}),
        ({SCALING: 4, UNITS: 7, DISC: 16384}, {DISC}),
        ({DISC: 4096}, {SCALING}),
        # Both timers may be one value.
        ({DISC: 4096, TIMER: 0}, {SCALING, TIMER}),
        ({DISC: 4096, TIMER: 10}, {SCALING}),
    ],
)
def test_objects_are_excused_where_others_are_right(objects, excused):
    assert RULES.excused(of(objects)) == excused


@pytest.mark.parametrize(
    ('objects', 'count'),
    [
        ({UNITS: 16384, canopen.HEARTBEAT_TIME: 0}, 0),
        ({UNITS: 16384}, 1),
        ({canopen.HEARTBEAT_TIME: 100}, 1),
        ({}, 2),
    ],
)
def test_what_no_object_says_is_a_remark(objects, count):
    assert len(RULES.remarks(of(objects))) == count


# A mapping of the first TPDO: speed in 16 bits, then the position in 32.
SPEED_FIRST = {(0x1A00, 0): 2, (0x1A00, 1): 0x60300110, (0x1A00, 2): 0x60040020}


@pytest.mark.parametrize(
    ('key', 'objects', 'hint'),
    [
        (UNITS, {UNITS: 4096}, 'set encoders.counts_per_turn: 4096'),
        (RANGE, {UNITS: 16384}, 'it counts turns: set encoders.mask: 0x3FFF'),
        (SCALING, {}, ''),
        (DISC, {}, ''),
        (
            (0x1A00, 0),
            SPEED_FIRST,
            'it sends 0x6030:01 with 16 bits, 0x6004:00 with 32 bits: set '
            'encoders.data_length: 6 and encoders.byte_offset: 2',
        ),
        (
            (0x1A03, 1),
            {(0x1A03, 0): 1, (0x1A03, 1): 0x60300110},
            'it sends 0x6030:01 with 16 bits, and no position',
        ),
        # The data of a frame are whole bytes, the last one filled up.
        (
            (0x1A00, 0),
            {(0x1A00, 0): 2, (0x1A00, 1): 0x60040020, (0x1A00, 2): 0x65030001},
            'it sends 0x6004:00 with 32 bits, 0x6503:00 with 1 bits: set '
            'encoders.data_length: 5 and encoders.byte_offset: 0',
        ),
        ((0x1A00, 0), {}, 'it sends nothing, and no position'),
        ((0x1A04, 0), SPEED_FIRST, ''),
        ((0x19FF, 0), SPEED_FIRST, ''),
        (canopen.HEARTBEAT_TIME, {}, ''),
    ],
)
def test_what_cannot_be_written_has_a_remedy(key, objects, hint):
    assert RULES.hint(key, of(objects)) == hint


def every_object(layout=LAYOUT, sync_id=0x80):
    """Return the wanted objects of an encoder with node id 2, by their names."""
    wanted = wanted_objects(layout, 2, sync_id, period=0.01, heartbeat=0.1)
    return {each.address: each for each in wanted.every}


# Sizes of these objects by CiA 301 and 406, bytes.
SIZES = {
    '0x1800:01': 4,
    '0x1800:02': 1,
    '0x1800:03': 2,
    '0x1800:05': 2,
    '0x1A00:00': 1,
    '0x1A00:01': 4,
    '0x1801:01': 4,
    '0x1802:01': 4,
    '0x1803:01': 4,
    '0x1005:00': 4,
    '0x1006:00': 4,
    '0x1019:00': 1,
    '0x1017:00': 2,
    '0x6000:00': 2,
    '0x6001:00': 4,
    '0x6501:00': 4,
    '0x6002:00': 4,
    '0x6200:00': 2,
}


def test_objects_have_the_sizes_of_the_standard():
    assert {address: each.size for address, each in every_object().items()} == SIZES


@pytest.mark.parametrize('sync_id', [0x80, None])
def test_an_encoder_needs_an_identifier_and_a_type_and_may_lack_the_rest(sync_id):
    objects = every_object(sync_id=sync_id)
    needed = {address for address, each in objects.items() if not each.holds(None)}
    assert needed == {'0x1800:01', '0x1800:02'}


def test_only_the_counts_of_the_disc_cannot_be_written():
    objects = every_object()
    assert [address for address, each in objects.items() if each.of_device] == ['0x6501:00']


@pytest.mark.parametrize(
    ('address', 'present', 'is_wanted'),
    [
        # The range of a turn, or the largest position in it.
        ('0x6002:00', 16384, True),
        ('0x6002:00', 16383, True),
        ('0x6002:00', 16382, False),
        ('0x6002:00', 16385, False),
        # The scaling; the direction of counting is left as it is.
        ('0x6000:00', 0b101, True),
        ('0x6000:00', 0b011, False),
        # Bit 30 of SYNC: the node makes it; bit 30 of a TPDO: it takes no requests.
        ('0x1005:00', 0x80000080, True),
        ('0x1005:00', 0x40000080, False),
        ('0x1005:00', 0x20000080, False),
        ('0x1005:00', 0x81, False),
        ('0x1800:01', 0x40000182, True),
        ('0x1800:01', 0x80000182, False),
        ('0x1800:01', 0x20000182, False),
        ('0x1800:01', 0x183, False),
        ('0x1801:01', 0x80000282, True),
        ('0x1801:01', 0x282, False),
    ],
)
def test_only_the_bits_that_matter_are_compared(address, present, is_wanted):
    assert every_object()[address].holds(present) is is_wanted


def values_of(layout=LAYOUT, sync_id=0x80, **options):
    """Return the wanted values of an encoder with node id 2, by the names of the objects."""
    settings = {'period': 0.01, 'heartbeat': 0.1, **options}
    wanted = wanted_objects(layout, 2, sync_id, **settings)
    return {each.address: each.value for each in wanted.every}


# The values of an encoder on a bus with SYNC.
ALL = {
    '0x1800:01': 0x182,
    '0x1800:02': 1,
    '0x1800:03': 0,
    '0x1800:05': 0,
    '0x1A00:00': 1,
    '0x1A00:01': 0x60040020,
    '0x1801:01': 0x80000000,
    '0x1802:01': 0x80000000,
    '0x1803:01': 0x80000000,
    '0x1005:00': 0x80,
    '0x1006:00': 0,
    '0x1019:00': 0,
    '0x1017:00': 100,
    '0x6000:00': 4,
    '0x6001:00': 16384,
    '0x6501:00': 16384,
    '0x6002:00': 16384,
    '0x6200:00': 0,
}


def without(*addresses):
    """Return the usual values but for some objects."""
    return {address: value for address, value in ALL.items() if address not in addresses}


def test_an_encoder_answers_sync_with_its_position_alone():
    assert values_of() == ALL
    assert values_of(sync_id=0x99)['0x1005:00'] == 0x99


def test_without_sync_an_encoder_sends_by_its_timer():
    timed = {'0x1800:02': 254, '0x1800:05': 10}
    assert values_of(sync_id=None) == without('0x1005:00', '0x1019:00') | timed


@pytest.mark.parametrize(
    'changes',
    [
        {'data_length': 8},
        {'data_length': 5, 'byte_offset': 1},
        {'bit_length': 24},
        {'byte_order': 'big'},
    ],
)
def test_a_mapping_of_more_than_the_position_is_left_as_it_is(changes):
    assert values_of(replace(LAYOUT, **changes)) == without('0x1A00:00', '0x1A00:01')


def test_a_mask_selects_the_turn_of_an_encoder_that_counts_turns():
    assert values_of(replace(LAYOUT, mask=0x3FFF)) == without('0x6002:00')


def test_a_slide_has_no_counts_per_turn():
    scaling = ('0x6000:00', '0x6001:00', '0x6501:00', '0x6002:00')
    assert values_of(is_linear=True) == without(*scaling)


def test_an_identifier_of_29_bits_is_marked_and_of_the_first_tpdo():
    values = values_of(replace(LAYOUT, can_id=0x18FF1234, extended=True))
    assert values == ALL | {'0x1800:01': 0x18FF1234 | 1 << 29}
    # Its number alone would be that of the third TPDO.
    values = values_of(replace(LAYOUT, can_id=0x382, extended=True))
    assert values['0x1800:01'] == 0x382 | 1 << 29


def test_an_identifier_of_another_tpdo_is_sent_by_that_one():
    values = values_of(replace(LAYOUT, can_id=0x482))
    assert values['0x1803:01'] == 0x482
    assert values['0x1800:01'] == values['0x1802:01'] == 0x80000000
    assert values['0x1A03:01'] == 0x60040020
    # The cyclic timer is that of the first.
    assert '0x6200:00' not in values


@pytest.mark.parametrize(
    ('can_id', 'objects', 'cyclic'),
    [
        (0x182, {(0x1800, 5): 7}, 0),
        (0x182, {}, 10),
        (0x282, {}, None),
    ],
)
def test_without_an_event_timer_the_cyclic_one_sends(can_id, objects, cyclic):
    layout = replace(LAYOUT, can_id=can_id)
    wanted = wanted_objects(layout, 2, None, period=0.01, heartbeat=0.1)
    adapted = wanted.rules.adapted(wanted, of(objects))
    values = {each.key: each.value for each in adapted.every}
    assert values.get(TIMER) == cyclic
