# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A zero that slipped by less than a fault: fkm reports it while its orientations go on."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rig_as_built import calibration, LOG, mechanism
from spm_haptic_master.ros.overload import TOO_BUSY

pytestmark = pytest.mark.process

# Time for a program to start and for the topics to be matched (s).
PATIENCE = 60.0
# Counts by which th1B slips: 0.18 deg.
SLIP = 8
# Silences of a machine that stopped a process for a time.
STALLED = ('no joint samples', 'stale sample', TOO_BUSY)


@pytest.fixture
def calibration_file(tmp_path):
    """Write a calibration that no longer holds."""
    zero = calibration()['encoders.zero_count']
    values = calibration() | mechanism() | {
        'encoders.zero_count': [zero[0], zero[1] + SLIP, *zero[2:]], 'bias_deg': [0.07] * 4}
    path = tmp_path / 'calibration.yaml'
    path.write_text('/**:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n'.replace('True', 'true') for name, value in values.items()))
    return path


def test_a_drift_is_a_warning_while_orientations_go_on(start, observer, calibration_file):
    entries = observer.collect(DiagnosticArray, '/diagnostics')
    start('fkm', '--params-file', str(calibration_file))
    assert observer.spin_until(
        lambda: observer.node.count_publishers('orientation') == 1, PATIENCE)
    driver = start('encoder_driver', '--params-file', str(calibration_file),
                   parameters={'source': 'replay', 'replay.path': LOG})

    def reported():
        return [status for _, array in entries for status in array.status
                if status.name == 'fkm: orientation' and 'calibration: ' in status.message]

    assert observer.spin_until(lambda: reported() or driver.poll() is not None, PATIENCE)
    found = reported()[0]
    assert found.level == DiagnosticStatus.WARN
    assert found.message.partition('calibration: ')[1] and 'joint_1b' in found.message
    assert found.message.endswith(' since')
    values = {each.key: float(each.value) for each in found.values
              if each.key.startswith(('calibration', 'joint_1b drift'))}
    assert abs(values['joint_1b drift (deg)']) > 0.1
    assert values['calibration: slow parity (deg)'] > 0.03
    assert values['calibration: figure of merit'] > 0.5
    # A busy machine may stop each process for a time.
    silences = {status.message for _, array in entries for status in array.status
                if status.name == 'fkm: orientation' and 'silent: ' in status.message}
    assert {text for text in silences if not any(words in text for words in STALLED)} == set()
