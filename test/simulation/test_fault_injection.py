# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults as texts: what they mean, and what is refused."""

import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.simulation.fault_injection import Fault, parse_fault, parse_switched


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        ('offset:joint_3c@5+2=-1.5', ('offset', 5, 5.0, 7.0, -1.5)),
        ('silence@1.5', ('silence', None, 1.5, float('inf'), 0.0)),
        ('emcy:joint_1b@0=0x18130', ('emcy', 1, 0.0, float('inf'), 0x8130)),
        ('loss:joint_1a@0=100', ('loss', 0, 0.0, float('inf'), 100.0)),
    ],
)
def test_a_fault_is_what_its_text_says(text, fault):
    found = parse_fault(text, 6)
    assert found == Fault(*fault, text)
    assert found.active(found.start)
    assert not found.active(found.end)


def test_a_switched_fault_begins_at_once():
    text = 'offset:joint_3b=2'
    assert parse_switched(text, 5) == Fault('offset', 4, 0.0, float('inf'), 2.0, text)


@pytest.mark.parametrize(
    ('text', 'wrong'),
    [
        ('', 'expected KIND'),
        ('dropout', 'expected KIND'),
        ('dropout@1', "joint 'None'"),
        ('dropout:joint_3b@1', 'expected one of joint_1a, .*, joint_3a$'),
        ('melt:joint_1a@1', "kind 'melt'"),
        ('silence:joint_1a@1', 'no joint'),
        ('offset:joint_1a@1', r'=VALUE \(deg\)'),
        ('dropout:joint_1a@1=3', 'no value with dropout'),
        ('offset:joint_1a@1=x', 'not a number'),
        ('emcy:joint_1a@1=1.5', 'not a number'),
        ('dropout:joint_1a@1.2.3', 'not a number'),
        ('dropout:joint_1a@1+0', 'duration above 0'),
        (f'dropout:joint_1a@{10**400}', 'START is inf'),
        ('offset:joint_1a@1=nan', 'VALUE is nan'),
        ('noise:joint_1a@1=-1', '0 or more'),
        ('late:joint_1a@1=0', 'above 0 '),
        ('loss:joint_1a@1=0', 'above 0, to 100'),
        ('loss:joint_1a@1=101', 'above 0, to 100'),
    ],
)
def test_a_fault_that_cannot_be_is_refused(text, wrong):
    with pytest.raises(InputError, match=f"^fault '.*{wrong}"):
        parse_fault(text)


@pytest.mark.parametrize(
    'text',
    [
        '',
        'melt:joint_1a',
        'stuck',
        'offset:joint_1a=x',
        'stuck:joint_1a@2',
        'stuck:joint_3b',
        'silence',
    ],
)
def test_a_switched_fault_that_cannot_be_is_refused(text):
    with pytest.raises(InputError, match='fault'):
        parse_switched(text)
