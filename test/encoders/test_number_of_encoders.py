# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five and six encoders: their settings, their defaults, their sets."""

from encoder_frames import answer, cycle, decoder, feed, PERIOD, sync, T0, values
import numpy as np
import pytest
from spm_haptic_master.encoders.bus_load import check_bus_load
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.encoders.directions import unverified_joints
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.tools.command_line import checked

ANGLES = (0.1, 0.2, 0.3, 0.4, -0.5, 0.6)


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_set_is_one_answer_of_each_encoder(sensors):
    taker = decoder(sensors=sensors)
    layouts = tuple(encoder.layout for encoder in taker.encoders)
    assert tuple(layout.joint for layout in layouts) == ALL_JOINT_NAMES[:sensors]
    *most, last = cycle(0, ANGLES[:sensors], layouts)
    assert feed(taker, most) == []
    (sample,) = feed(taker, [last])
    assert sample.stamp == round(T0 * 1e9)
    np.testing.assert_allclose(sample.angles, ANGLES[:sensors], atol=2e-4)


def test_the_answer_missing_is_named():
    taker = decoder(sensors=6)
    layouts = tuple(encoder.layout for encoder in taker.encoders)
    assert feed(taker, [*cycle(0, ANGLES[:3], layouts), sync(T0 + PERIOD)]) == []
    assert taker.assembler.cause == 'no answer from joint_3a, joint_3b, joint_3c'


def test_an_encoder_that_is_not_configured_is_foreign():
    layouts = tuple(encoder.layout for encoder in decoder(sensors=6).encoders)
    taker = decoder(sensors=5)
    (sample,) = feed(taker, cycle(0, ANGLES, layouts))
    assert len(sample.angles) == 5
    assert taker.counters['rejected: foreign identifier'] == 1


def test_defaults_of_four_stay_and_extend():
    four, six = values(), values(sensors=6)
    assert four['encoders.id'] == (0x181, 0x182, 0x183, 0x184)
    assert six['encoders.id'] == (*four['encoders.id'], 0x185, 0x186)
    assert six['encoders.node_id'] == (1, 2, 3, 4, 5, 6)
    for name in ('encoders.data_length', 'encoders.byte_order', 'encoders.harmonic_cos_deg'):
        assert six[name] == (*four[name], *four[name][-1:] * 2)
    assert values('sim', sensors=5)['encoders.counts_per_turn'] == (16384,) * 5


@pytest.mark.parametrize(('sensors', 'name', 'value'), [
    (6, 'encoders.zero_count', [1, 2, 3, 4]), (5, 'encoders.direction', [1, 1, 1, 1, 1, 1]),
    (4, 'encoders.direction_verified', [True] * 6), (6, 'encoders.id', [1, 2, 3, 4]),
    (5, 'encoders.node_id', [1, 2, 3, 4])])
def test_lists_of_another_length_are_refused(sensors, name, value):
    with pytest.raises(SettingError, match=rf"'{name}' .*a list of {sensors}, .*"
                                           rf'\(sensors: {sensors}\)'):
        checked(simulated_rig(sensors) | {'sensors': sensors, name: value},
                SOURCE_SETTINGS['can'], 'can')


def test_other_numbers_of_sensors_are_refused():
    with pytest.raises(SettingError, match="'sensors' is 3; expected one of 4, 5, 6"):
        checked({'sensors': 3}, SOURCE_SETTINGS['sim'], 'sim')


def test_all_encoders_are_different():
    with pytest.raises(SettingError, match='six different identifiers; joint_1a and joint_3c'):
        decoder(sensors=6, encoders__id=(0x181, 0x182, 0x183, 0x184, 0x185, 0x181))
    with pytest.raises(SettingError, match='five different node ids'):
        decoder(sensors=5, encoders__node_id=(1, 2, 3, 4, 4))


def test_a_table_of_the_sixth_encoder_is_its_own():
    bent = make_decoder(values(sensors=6, **{
        'encoders__table_deg__joint_3c': (0.0, 0.1, 0.0, -0.1, 0.0)}))
    assert [encoder.layout.harmonics is None for encoder in bent.encoders] == [True] * 5 + [False]


def test_the_sixth_direction_has_to_be_verified():
    with pytest.raises(SettingError, match='the direction of joint_3c is not verified'):
        unverified_joints(values(
            sensors=6, encoders__direction_verified=(True, True, True, True, True, False)))


def test_six_answers_need_more_of_the_bus():
    def load(sensors):
        taker = decoder(sensors=sensors)
        check_bus_load(tuple(each.layout for each in taker.encoders), True, 1600.0, 1_000_000)

    load(5)
    with pytest.raises(SettingError, match='SYNC and six answers'):
        load(6)


def test_a_wrong_answer_of_the_fifth_is_counted():
    taker = decoder(sensors=5)
    layouts = tuple(encoder.layout for encoder in taker.encoders)
    feed(taker, [answer(4, T0, layouts=layouts, data=bytes(3))])
    assert taker.tally()['joint_3b rejected: 3 bytes instead of 4'] == 1
