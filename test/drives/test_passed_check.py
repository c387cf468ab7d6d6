# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A3: torque only for drives that a force_check has passed, as it has found them."""

import json

from drive_rig import drive_values, Rig
from harness import SIMULATED_CHECK
import pytest
from spm_haptic_master.drives.drive_factory import make_drives
from spm_haptic_master.drives.passed_check import read_check
from spm_haptic_master.exceptions import InputError, SettingError

TORQUES = (0.1, -0.2, 0.05)


@pytest.fixture
def file(tmp_path):
    """Return what writes the check of the simulated drives with changes of the second one."""

    def write(**changed):
        content = json.loads(SIMULATED_CHECK.read_text())
        identity = changed.pop('identity', {})
        content['drives'][1]['identity'] |= identity
        content['drives'][1] |= changed
        path = tmp_path / 'check.json'
        path.write_text(json.dumps(content))
        return path

    return write


def test_without_a_passed_check_there_are_no_drives():
    with pytest.raises(SettingError) as caught:
        make_drives(drive_values(drives__check_file=''))
    assert caught.value.name == 'drives.check_file'
    assert 'no torque without a passed check' in str(caught.value)


@pytest.mark.parametrize(
    ('changed', 'words'),
    [
        ({'direction': -1}, 'joint_1b: direction -1 was checked, 1 is configured'),
        ({'gear': 2.0}, 'joint_1b: gear 2.0 was checked, 1.0 is configured'),
        ({'rated_torque': 5.0}, 'joint_1b: rated torque 5.0 was checked, 0.5 is configured'),
        ({'node_id': 22}, 'joint_1b: node id 22 was checked, 12 is configured'),
        ({'joint': 'joint_1c'}, 'joint joint_1c was checked'),
        ({'gear': float('inf')}, 'joint_1b: gear inf was checked, 1.0 is configured'),
        ({'gear': float('nan')}, 'joint_1b: gear nan was checked, 1.0 is configured'),
    ],
)
def test_what_is_configured_in_another_way_than_checked_is_refused(file, changed, words):
    with pytest.raises(SettingError) as caught:
        make_drives(drive_values(drives__check_file=str(file(**changed))))
    assert caught.value.name == 'drives.check_file'
    assert words in str(caught.value)


def test_another_number_of_drives_than_checked_is_refused():
    with pytest.raises(SettingError, match='3 drives were checked, 4 are configured'):
        make_drives(drive_values(drives__node_id=[11, 12, 13, 14]))


@pytest.mark.parametrize('text', ['', '[]', '{"kind": "calibration"}', '{"drives": 1}'])
def test_a_file_that_is_no_check_is_named(tmp_path, text):
    path = tmp_path / 'other.json'
    path.write_text(text)
    with pytest.raises(InputError, match='other.json: expected the file of a passed force_check'):
        make_drives(drive_values(drives__check_file=str(path)))
    with pytest.raises(InputError, match='none.json: expected the file'):
        make_drives(drive_values(drives__check_file=str(tmp_path / 'none.json')))


@pytest.mark.parametrize(
    'changed',
    [
        {'gear': None},
        {'rated_torque': 'one'},
        {'node_id': [12]},
        {'direction': 'left'},
        {'identity': {'serial': 'unknown'}},
        {'identity': {'vendor': [1]}},
    ],
)
def test_a_file_whose_values_are_none_is_named(file, changed):
    """By hand, or by another program: the text of a refusal has to name it, not a traceback."""
    with pytest.raises(InputError, match='check.json: expected the file of a passed force_check'):
        make_drives(drive_values(drives__check_file=str(file(**changed))))


@pytest.mark.parametrize('name', ['polarity', 'serial'])
def test_a_file_that_lacks_what_tells_a_drive_is_to_be_recorded_anew(file, name):
    """One that an older version has written knows no polarity."""
    path = file()
    content = json.loads(path.read_text())
    del content['drives'][1]['identity'][name]
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=f"check.json: .*it has no '{name}': record it anew"):
        read_check(path)


@pytest.mark.parametrize(
    ('content', 'words'),
    [
        (b'', 'Expecting value: line 1 column 1'),
        (b'\xff' * 9999, "'utf-8' codec can't decode byte 0xff in position 0"),
        (b'[' * 9999, 'maximum recursion depth'),
        (b'{"kind": "%s"}' % (b'x' * 9999), "kind 'xxx"),
        (SIMULATED_CHECK.read_bytes().replace(b'12,', b'1e999,', 1), 'cannot convert float inf'),
    ],
)
def test_a_file_that_is_no_check_is_one_short_line(tmp_path, content, words):
    path = tmp_path / 'check.json'
    path.write_bytes(content)
    with pytest.raises(InputError, match='check.json: expected the file of a') as caught:
        read_check(path)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 500
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('name', ['vendor', 'product', 'serial', 'polarity'])
def test_another_drive_than_the_checked_one_gets_no_torque(file, name):
    """Two drives that were exchanged, a new one, or one set anew may turn another way."""
    check = read_check(file(identity={name: 99}))
    with Rig(check=check) as rig:
        report = rig.run(TORQUES, 2.0)
        assert not report.ready
        assert report.fault.startswith('drive of joint_1b (node 12): vendor 0x0, product 0x')
        assert report.fault.endswith('run force_check again')
        assert {torque for _, torque in rig.commands()} <= {0}


def test_the_check_of_drives_is_the_one_that_they_need(tmp_path):
    path = tmp_path / 'check.json'
    with Rig() as rig:
        rig.ready()
        rig.drives.passed_check('2026-11-26T12:00:00Z').write(path)
    found = read_check(path)
    assert found.drives == read_check(SIMULATED_CHECK).drives
    with Rig(check=found) as rig:
        rig.ready(TORQUES)
    with pytest.raises(InputError, match='cannot be written'):
        found.write(tmp_path / 'none' / 'check.json')
