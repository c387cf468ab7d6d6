# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings that cannot be are refused in a line: the name, the value, what is allowed."""

from contextlib import nullcontext
import re

from encoder_frames import cycle, decoder, feed, T0, values
from harness import DATA
import pytest
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.simulation.source_factory import make_source
import yaml


def test_an_interface_that_python_can_does_not_have_is_refused():
    with pytest.raises(SettingError, match="'can.interface' is 'nonsense'; expected one of"):
        make_source('can', values(can__interface='nonsense'))


@pytest.mark.parametrize(
    'case', yaml.safe_load((DATA / 'encoders/settings.yaml').read_text()), ids=str
)
def test_settings_are_checked_against_each_other(case):
    joint, given, *expected = case
    overrides = dict(given)
    if joint != 'all':
        overrides = {f'encoders.{name}': [*values()[f'encoders.{name}']] for name in given}
        for name, value in given.items():
            overrides[f'encoders.{name}'][JOINT_NAMES.index(joint)] = value
    with pytest.raises(SettingError, match=expected[0]) if expected else nullcontext():
        decoder(**overrides)


@pytest.mark.parametrize(
    ('bitrate', 'rate', 'overrides', 'words'),
    [
        (250_000, 545.0, {}, None),
        (0, 9000.0, {}, None),
        # 435 bits at 950 Hz are exactly 95 %.
        (435_000, 950.0, {}, None),
        (
            250_000,
            600.0,
            {},
            "parameter 'rate' is 600.0; expected at most 546 Hz at can.bitrate "
            '250000: a cycle of SYNC and four answers has up to 435 bits, and 435 bits x '
            '600 Hz / 250000 '
            'bit/s = 104 % bus load, beyond 95 %',
        ),
        (250_000, 1000.0, {'encoders__sync_id': 0}, 'a cycle of four answers has up to 380 bits'),
        (
            500_000,
            1000.0,
            {'insertion__id': 0x185},
            'a cycle of SYNC and five answers has up to 530 bits',
        ),
        (1_000_000, 1600.0, {'sensors': 6}, 'SYNC and six answers'),
        # Stuffed: 135 bits for a frame of eight bytes, 160 with 29 bits (CAN in Automation).
        (
            500_000,
            1000.0,
            {'encoders__data_length': (8,) * 4, 'encoders__extended': (False, True, False, False)},
            'up to 620 bits',
        ),
    ],
)
def test_a_rate_that_the_bus_cannot_carry_is_refused_with_the_arithmetic(
    bitrate, rate, overrides, words
):
    settings = values(
        can__interface='virtual',
        can__bitrate=bitrate,
        rate=rate,
        **overrides,
    )
    with pytest.raises(SettingError, match=re.escape(words)) if words else nullcontext():
        make_source('can', settings).close()


@pytest.mark.parametrize(
    ('source', 'given'),
    [
        ('can', {}),
        ('replay', {'replay__path': '/data/session.log'}),
    ],
)
def test_what_decodes_counts_needs_verified_directions(source, given):
    assert unverified_joints(values(source, **given)) == unverified_joints(values('sim')) == ()
    some = {**given, 'encoders__direction_verified': (True, False, True, False)}
    with pytest.raises(SettingError, match='direction of joint_1b, joint_3a is not verified'):
        unverified_joints(values(source, **some))
    assert unverified_joints(
        values(source, **some, encoders__accept_unverified_directions=True)
    ) == ('joint_1b', 'joint_3a')


@pytest.mark.parametrize(
    ('given', 'longest'),
    [
        # Three periods, at most 5 ms; half a period without SYNC; as it is set.
        ({'rate': 1000.0}, 0.003),
        ({'rate': 500.0}, 0.005),
        ({'rate': 100.0}, 0.005),
        ({'rate': 1000.0, 'encoders__sync_id': 0}, 0.0005),
        ({'rate': 100.0, 'encoders__window': 0.002}, 0.002),
    ],
)
def test_an_answer_is_taken_within_its_window(given, longest):
    for delay, count in ((0.97 * longest, 1), (1.03 * longest, 0)):
        messages = cycle(0)[1 if 'encoders__sync_id' in given else 0 :]
        for message in messages[:-1]:
            message.timestamp = T0
        messages[-1].timestamp = T0 + delay
        assert len(feed(decoder(**given), messages)) == count


@pytest.mark.parametrize(
    ('excess', 'fits'),
    [
        (0.9e-5, True),
        (1.1e-5, False),
    ],
)
def test_a_window_of_three_periods_may_be_rounded(excess, fits):
    refused = pytest.raises(SettingError, match="'encoders.window'")
    with nullcontext() if fits else refused:
        decoder(rate=1000.0, encoders__window=0.003 * (1.0 + excess))
