# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the objects of a drive have to be: simulated drives have the same, wrong or right."""

from drive_rig import make_test_plan
import pytest
from spm_haptic_master.drives.drive_objects import drive_objects

# Index, subindex, bytes and value, by docs/force.md and CiA 301 and 402; node 12 of 11 to 13.
OWN_RPDO = {
    (0x1400, 1, 4, 0x20C),
    (0x1400, 2, 1, 255),
    (0x1400, 5, 2, 10),
    (0x1600, 0, 1, 2),
    (0x1600, 1, 4, 0x60400010),
    (0x1600, 2, 4, 0x60710010),
}
COMBINED_RPDOS = {
    (0x1400, 1, 4, 0x20C),
    (0x1400, 2, 1, 255),
    (0x1600, 0, 1, 1),
    (0x1600, 1, 4, 0x60400010),
    (0x1401, 1, 4, 0x30B),
    (0x1401, 2, 1, 255),
    (0x1401, 5, 2, 10),
    (0x1601, 0, 1, 3),
    (0x1601, 1, 4, 0x00030010),
    (0x1601, 2, 4, 0x60710010),
    (0x1601, 3, 4, 0x00030010),
}
STATUS = {
    (0x1800, 1, 4, 0x18C),
    (0x1800, 2, 1, 255),
    (0x1800, 3, 2, 40),
    (0x1800, 5, 2, 4),
    (0x1A00, 0, 1, 3),
    (0x1A00, 1, 4, 0x60410010),
    (0x1A00, 2, 4, 0x60770010),
    (0x1A00, 3, 4, 0x60610008),
    (0x1801, 1, 4, 1 << 31),
    (0x1802, 1, 4, 1 << 31),
    (0x1803, 1, 4, 1 << 31),
}
OTHERS = {
    # The torque that it is to make, and that it makes: any value.
    (0x6071, 0, 2, 0),
    (0x6077, 0, 2, 0),
    (0x1016, 1, 4, 126 << 16 | 60),
    (0x1017, 0, 2, 20),
    (0x1029, 1, 1, 1),
    (0x6007, 0, 2, 2),
    (0x605A, 0, 2, 0),
    (0x605E, 0, 2, 0),
    (0x6072, 0, 2, 1000),
}
RATED = {(0x6076, 0, 4, 500)}
PERIOD = {(0x60C2, 1, 1, 1), (0x60C2, 2, 1, 0xFD)}


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({}, OWN_RPDO | RATED | PERIOD),
        ({'drives__combined': True}, COMBINED_RPDOS | RATED | PERIOD),
        ({'drives__event_timer': 0.0}, OWN_RPDO - {(0x1400, 5, 2, 10)} | RATED | PERIOD),
        ({'drives__torque_unit': 0.0, 'rate': 400.0}, OWN_RPDO),
        (
            {'drives__torque_unit': 1e-6, 'rate': 500.0},
            OWN_RPDO | {(0x6076, 0, 4, 500_000), (0x60C2, 1, 1, 2), (0x60C2, 2, 1, 0xFD)},
        ),
        # 3 rad/s with a gear of 1 are 28.6 turns a minute.
        ({'drives__speed_limit': 3.0}, OWN_RPDO | RATED | PERIOD | {(0x6080, 0, 4, 29)}),
    ],
)
def test_the_objects_of_a_drive_are_those_of_the_standards_and_the_documentation(given, expected):
    plan = make_test_plan(**given)
    found = [
        (each.index, each.subindex, each.size, each.value)
        for each in drive_objects(plan, plan.drives[1]).every
    ]
    assert len(set(found)) == len(found)
    assert set(found) == expected | STATUS | OTHERS


@pytest.mark.parametrize(
    ('given', 'syncs'),
    [
        ({'drives__status_by': 'sync'}, 1),
        ({'drives__status_by': 'encoder_sync'}, 4),
        ({'drives__status_by': 'encoder_sync', 'rate': 500.0}, 2),
    ],
)
def test_a_status_on_sync_has_no_timer(given, syncs):
    """Of the encoders' SYNC so many make a `drives.status_period`."""
    plan = make_test_plan(**given)
    found = {each.key: each.value for each in drive_objects(plan, plan.drives[0]).every}
    assert found[0x1800, 2] == syncs
    assert (0x1800, 3) not in found
    assert (0x1800, 5) not in found


def test_what_was_verified_by_hand_need_not_be_there_and_is_compared_where_it_is():
    plan = make_test_plan(drives__verified_by_hand='0x6072 0x1400:05')
    found = {each.key: each for each in drive_objects(plan, plan.drives[0]).every}
    assert (0x1400, 5) not in found
    assert found[0x6072, 0].holds(None)
    assert not found[0x6072, 0].holds(999)


def test_a_drive_need_not_have_every_object():
    plan = make_test_plan()
    optional = {
        (each.index, each.subindex)
        for each in drive_objects(plan, plan.drives[0]).every
        if each.optional
    }
    assert optional == {
        (0x1029, 1),
        (0x1801, 1),
        (0x1802, 1),
        (0x1803, 1),
        (0x60C2, 1),
        (0x60C2, 2),
    }
