# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One screen of what is wrong, and the exit code that says whether anything is."""

from dataclasses import replace
import threading

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from harness import Observer
from in_process import exit_code
import pytest
from spm_haptic_master.nodes import status
from spm_haptic_master.nodes.status_screen import Device, Entry, screen
from spm_haptic_master.parameters.nodes import NODE_SETTINGS
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN

HEALTHY = {
    'fkm: orientation': Entry(OK, 'healthy', {'joint_1a noise (deg)': '0.02'}),
    'encoder_driver: encoders': Entry(
        OK,
        'publishing [can: can0]',
        {
            'calibration': 'rig 7 of 2026-11-25',
            'mechanism': 'e30770fb',
            'joint_1a: frame rate (Hz)': '1000',
            'directions not verified': 'none',
        },
    ),
    'fkm: timing': Entry(OK, 'in time'),
}


def device(**changed):
    return Device('', {**HEALTHY, **{name.replace('__', ': '): e for name, e in changed.items()}})


def test_a_healthy_device_has_its_calibration_and_each_encoder_in_a_line():
    found = device()
    found.limits = {'fkm': 'alert_limit_deg 1', 'teleop': None}
    found.states = {'operating_state_text': 'ENABLED'}
    assert found.is_well()
    assert screen(found) == [
        'ok    state           healthy',
        'ok    bus             publishing [can: can0]',
        '        joint_1a      frame rate (Hz) 1000, noise (deg) 0.02',
        '      calibration     rig 7 of 2026-11-25, mechanism e30770fb',
        '      limits          fkm: alert_limit_deg 1',
        '      limits          unknown: teleop does not answer',
        'ok    machine         in time',
        '      operating state ENABLED',
    ]


def test_a_silent_device_shows_its_reason_with_the_remedy():
    silent = Entry(ERROR, "silent: no orientation fits: the calibration may be another rig's")
    found = device(fkm__orientation=silent)
    assert not found.is_well()
    assert screen(found)[0] == (
        "ERROR state           silent: no orientation fits: the calibration may be another rig's"
    )


@pytest.mark.parametrize('level', [WARN, ERROR])
@pytest.mark.parametrize('name', [*HEALTHY, 'teleop: teleop', 'presence: pedals', 'fkm: force'])
def test_one_entry_that_warns_is_not_well(name, level):
    assert not Device('', {**HEALTHY, name: Entry(level, 'x')}).is_well()


def test_a_node_that_does_not_report_is_an_error():
    without_fkm = device()
    del without_fkm.entries['fkm: orientation']
    assert not without_fkm.is_well()
    assert screen(without_fkm)[0] == 'ERROR state           no fkm answers'
    without_driver = device()
    del without_driver.entries['encoder_driver: encoders']
    assert 'ERROR bus             no encoder_driver answers' in screen(without_driver)


def test_directions_drives_and_pedals_are_shown():
    driver = HEALTHY['encoder_driver: encoders']
    unverified = replace(driver, values={**driver.values, 'directions not verified': 'joint_3a'})
    lines = screen(
        device(
            encoder_driver__encoders=unverified,
            fkm__force=Entry(OK, 'ready', {'drive 11': 'operation enabled', 'wrench': '0'}),
            presence__pedals=Entry(WARN, 'no joystick'),
        )
    )
    assert any(line.endswith('directions not verified: joint_3a') for line in lines)
    assert '        drives        drive 11: operation enabled' in lines
    assert 'WARN  presence        no joystick' in lines


@pytest.fixture
def running(request):
    """Give a device whose entry has the level of the test."""
    device = Observer('fkm')
    ended = threading.Event()
    node = device.node
    for name in status.LIMITS['fkm']:
        node.declare_parameter(name, 1.5)
    out = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
    values = [KeyValue(key='calibration', value='rig 7')]
    entries = [
        DiagnosticStatus(
            level=request.param,
            name='fkm: orientation',
            message='healthy',
        ),
        DiagnosticStatus(
            level=OK, name='encoder_driver: encoders', message='publishing', values=values
        ),
    ]
    node.create_timer(0.05, lambda: out.publish(DiagnosticArray(status=entries)))
    thread = threading.Thread(target=device.spin_until, args=(ended.is_set, 600.0))
    thread.start()
    yield device
    ended.set()
    thread.join()
    device.close()


@pytest.mark.parametrize(
    ('running', 'code'),
    [(OK, 0), (ERROR, 1)],
    indirect=['running'],
)
def test_the_exit_code_says_whether_all_is_well(running, code, capfd):
    assert exit_code(status.main, 'status', '--seconds', '2') == code
    out = capfd.readouterr().out
    assert 'state           healthy\n' in out
    assert 'calibration     rig 7' in out
    assert 'limits          fkm: alert_limit_deg 1.5, unchecked_limit 1.5' in out


@pytest.mark.parametrize('args', [(), ('--ros-args', '-r', '__ns:=/left')])
def test_without_a_device_it_says_so(args, capfd):
    assert exit_code(status.main, 'status', '--seconds', '0.1', *args) == 1
    out, err = capfd.readouterr()
    assert out == ''
    assert err.startswith('status: nothing reports in ')
    assert err.count('\n') == 1


def test_the_limits_are_parameters_of_their_nodes():
    for node, names in status.LIMITS.items():
        assert set(names) <= {setting.name for setting in NODE_SETTINGS[node]}


def test_slide_and_gripper_have_a_line_each_with_position_and_age():
    lost = Entry(ERROR, 'insertion missing (no frames)', {'position': '0.1', 'age (ms)': '412'})
    grip = Entry(OK, 'publishing', {'position': '0.5', 'age (ms)': '1'})
    found = device(encoder_driver__insertion=lost, encoder_driver__gripper=grip)
    assert not found.is_well()
    lines = screen(found)
    assert (
        'ERROR insertion       insertion missing (no frames), position 0.1 m, age (ms) 412'
        in lines
    )
    assert 'ok    gripper         publishing, position 0.5 rad, age (ms) 1' in lines
    assert not any('insertion' in line or 'gripper' in line for line in screen(device()))
