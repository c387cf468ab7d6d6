# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the launch file starts from its arguments, and what it refuses before anything starts."""

import json

from harness import SIMULATED_CHECK
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.launch_plan import Follower, plan
from spm_haptic_master.parameters.files import config_directory

CALIBRATION = str(config_directory() / 'simulated_rig.yaml')
DRIVER = '/**/encoder_driver:\n  ros__parameters: {source: can}\n'


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Write parameter files into the home directory; return their paths."""
    monkeypatch.setenv('HOME', str(tmp_path))

    def write(content, name='rig.yaml'):
        (tmp_path / name).write_text(content)
        return str(tmp_path / name)

    return write


def launch(source='', config='', calibration='', namespace='', composed=True):
    return [
        (each.executable, list(each.arguments))
        for each in plan(source, config, calibration, namespace, composed)
    ]


def test_each_process_gets_the_files_that_have_something_for_it(file):
    rig = file(DRIVER)
    assert launch('', rig, CALIBRATION, composed=False) == [
        ('encoder_driver', ['--params-file', rig, '--params-file', CALIBRATION]),
        ('fkm', ['--params-file', CALIBRATION]),
        ('diagnostics', ['--params-file', CALIBRATION]),
    ]


@pytest.mark.parametrize('composed', [True, False])
def test_frames_with_a_prefix_are_those_that_the_files_do_not_name(file, composed):
    def words(config=''):
        (found,) = [
            each
            for each in plan(
                'sim',
                config,
                '',
                'left',
                composed,
                frame_prefix='left/',
            )
            if each.executable in ('fkm', 'master')
        ]
        return [word for word in found.arguments if ':=left/' in word]

    assert words() == [
        'frame_id:=left/spm_base',
        'mounting.platform_frame_id:=left/spm_platform',
        'mounting.handle_frame_id:=left/spm_handle',
    ]
    rig = file('/**/fkm:\n  ros__parameters: {frame_id: own_base}\n')
    assert words(rig) == words()[1:]


def test_names_in_a_namespace(file):
    rig = file('/left/encoder_driver:\n  ros__parameters: {source: sim}\n')
    assert launch('', rig, namespace='left') == [('master', ['--params-file', rig])]
    rig = file('left:\n  encoder_driver:\n    ros__parameters: {source: sim}\n')
    assert launch('', rig, namespace='/left')
    with pytest.raises(InputError, match=r'none of its entries reaches .* /right/encoder_driver'):
        launch('sim', rig, namespace='right')


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        ({}, "'source' is not set; expected one of can, replay, sim"),
        ({'source': 'can'}, "'encoders.zero_count' is not set"),
        ({'source': 'sim', 'config': '/no/such.yaml'}, 'config:=/no/such.yaml; .* does not exist'),
        (
            {'source': 'sim', 'config': '~/rig.yaml'},
            r'config:=~/rig.yaml; .*/rig.yaml: it does not',
        ),
        ({'source': 'sim', 'config': '~nouser/x'}, 'config:=~nouser/x; expected an existing file'),
        ({'source': 'sim', 'calibration': '/tmp'}, 'calibration:=/tmp; .* it is a directory'),
    ],
)
def test_what_cannot_run_is_refused(file, arguments, reason):
    with pytest.raises(InputError, match=reason) as error:
        launch(**arguments)
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(
    ('content', 'reason'),
    [
        ('/**/encoders_driver:\n  ros__parameters: {rate: 1.0}\n', 'none of its entries reaches'),
        ('/**:\n  ros__parameters: {rate: 1.0, rate: 2.0}\n', "key 'rate' is given twice"),
        (
            '/**/encoder_driver:\n  ros__parameters: {rate: 500.0}\n',
            "'rate' is 1000.0; expected the same value in fkm as in encoder_driver",
        ),
        ('/**/fkm:\n  ros__parameters: {geometry.beta_deg: 35.0}\n', "'geometry.beta_deg' is"),
        ('/**/fkm:\n  ros__parameters: {calibration: old}\n', "'calibration' is 'old'"),
    ],
)
@pytest.mark.parametrize('composed', [True, False])
def test_a_file_that_does_not_do_what_it_says_is_refused(file, content, reason, composed):
    source = 'replay' if 'calibration' in content else 'sim'
    with pytest.raises(InputError, match=reason) as error:
        launch(source, file(content), CALIBRATION, composed=composed)
    assert '\n' not in str(error.value)


def test_six_encoders_have_a_calibration_of_their_own(file):
    rig = file(DRIVER + '/**:\n  ros__parameters: {sensors: 6}\n')
    six = CALIBRATION.replace('simulated_rig', 'simulated_rig_six')
    assert launch('', rig, six) == [('master', ['--params-file', rig, '--params-file', six])]
    with pytest.raises(InputError, match=r"'encoders.\w+' is .*a list of 6, .*\(sensors: 6\)"):
        plan('', rig, CALIBRATION, '', True)
    other = file(DRIVER + '/**/fkm:\n  ros__parameters: {sensors: 5}\n', 'other.yaml')
    with pytest.raises(InputError, match="'sensors' is 5; expected the same value in fkm"):
        plan('', other, CALIBRATION, '', True)


def test_parameters_of_teleop_are_checked_before_the_start(file):
    rig = file('/**:\n  ros__parameters: {teleop: {speed_limit: 0.1}}\n')
    with pytest.raises(InputError, match=r'teleop.align_speed.*at most teleop.speed_limit'):
        plan('sim', rig, '', '', True, Follower())
    rig = file('/**/teleop:\n  ros__parameters: {rate: 500.0}\n')
    with pytest.raises(InputError, match=r"'rate'.*the same value in teleop as in"):
        plan('sim', rig, '', '', True, Follower())
    # Without teleop they have no effect, and are no error.
    assert plan('sim', rig, '', '', True)


def checked(node_ids, directory):
    """Write the passed check of simulated drives with other node ids; return its path."""
    content = json.loads(SIMULATED_CHECK.read_text())
    for drive, node_id in zip(content['drives'], node_ids, strict=True):
        drive['node_id'] = node_id
    path = directory / 'check.json'
    path.write_text(json.dumps(content))
    return str(path)


DRIVEN = {
    'force.enabled': True,
    'drives.channel': 'can1',
    'drives.rated_torque': [0.5],
    'drives.check_file': str(SIMULATED_CHECK),
}


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        ({'force.enabled': True}, "'force.without_drives' is False; .* drives.channel"),
        (
            {
                **DRIVEN,
                'drives.interface': 'socketcan',
                'drives.channel': 'can0',
                'source': 'can',
                'drives.node_id': [1, 2, 3],
            },
            "drives.node_id' is .* node ids that no encoder has",
        ),
    ],
)
@pytest.mark.parametrize('composed', [True, False])
def test_force_feedback_that_cannot_work_is_refused(file, given, reason, composed, tmp_path):
    if 'drives.node_id' in given:
        given = given | {'drives.check_file': checked(given['drives.node_id'], tmp_path)}
    rig = file(json.dumps({'/**': {'ros__parameters': {'can.protocol': 'canopen'} | given}}))
    with pytest.raises(InputError, match=reason):
        launch('' if 'source' in given else 'sim', rig, CALIBRATION, composed=composed)


def test_force_feedback_that_is_off_needs_no_drives(file):
    rig = file(
        json.dumps(
            {'/**': {'ros__parameters': {**DRIVEN, 'force.enabled': False, 'force.motors': 4}}}
        )
    )
    assert launch('sim', rig)
