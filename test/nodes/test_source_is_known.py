# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nobody takes a simulated or replayed angle for a measured one; two drivers are an error."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import QuaternionStamped
from harness import SIM, status
import pytest
from recording import LOG
from sensor_msgs.msg import JointState
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.ros.duplicate_publishers import CURE
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
ENTRY = 'encoder_driver: encoders'
REPLAY = {'source': 'replay', 'replay.path': LOG, 'replay.loop': True, **simulated_rig()}
BOTH = f'2 publishers on /measured_js: /encoder_driver, /other; {CURE}'
CAN = {'source': 'can', 'can.interface': 'udp_multicast', **simulated_rig()}


@pytest.mark.parametrize(('parameters', 'text'), [
    (SIM, 'sim'), (REPLAY, f'replay: {LOG.name}'), (CAN, 'can: udp_multicast CHANNEL')])
def test_the_source_is_on_a_latched_topic_and_on_diagnostics(
        start, observer, bus_channel, parameters, text):
    if parameters is CAN:
        parameters, text = {**CAN, 'can.channel': bus_channel}, text.replace(
            'CHANNEL', bus_channel)
    health = observer.collect(DiagnosticArray, '/diagnostics')
    start('encoder_driver', parameters=parameters)
    assert observer.spin_until(lambda: status(health, ENTRY), PATIENCE)
    late = observer.collect(String, 'source', STATE)
    assert observer.spin_until(lambda: late, PATIENCE)
    assert [message.data for _, message in late] == [text]
    entry = status(health, ENTRY)
    assert entry.message.endswith(f' [{text}]')
    assert entry.hardware_id == text
    assert {value.key: value.value for value in entry.values}['source'] == text


def test_arguments_without_ros_args_reach_the_nodes(start, observer):
    samples = observer.collect(JointState, '/left/measured_js')
    start('master', '-p', 'source:=sim', '-r', '__ns:=/left', '-p', 'rate:=200.0')
    assert observer.spin_until(lambda: len(samples) > 20, PATIENCE)


def test_parameters_override_files_wherever_they_stand(start, observer, tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text('/**/encoder_driver:\n  ros__parameters: {source: can}\n')
    late = observer.collect(String, 'source', STATE)
    start('encoder_driver', '--ros-args', '-p', 'source:=sim', '--params-file', str(path))
    assert observer.spin_until(lambda: late, PATIENCE)
    assert late[0][1].data == 'sim'


def test_two_drivers_on_one_topic_are_an_error_in_both_and_fkm_is_silent(start, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    health = observer.collect(DiagnosticArray, '/diagnostics')
    fkm = start('fkm')
    first = start('encoder_driver', parameters=SIM)
    assert observer.spin_until(
        lambda: (entry := status(health, ENTRY)) and entry.level == DiagnosticStatus.OK
        and orientations, PATIENCE)
    second = start('encoder_driver', '-r', '__node:=other', parameters=SIM)
    for name in (ENTRY, 'other: encoders'):
        assert observer.spin_until(
            lambda name=name: (entry := status(health, name))
            and entry.message.startswith(BOTH) and entry.message.endswith(' [sim]'), PATIENCE)
        assert status(health, name).level == DiagnosticStatus.ERROR
    assert observer.spin_until(
        lambda: status(health, 'fkm: orientation').message == f'silent: {BOTH}', PATIENCE)
    orientations.clear()
    observer.spin(1.0)
    assert orientations == []
    assert second.stop() == 0
    # What fkm took of both before it noticed may be a fault to it: test_two_sources.
    assert observer.spin_until(
        lambda: status(health, ENTRY).level == DiagnosticStatus.OK
        and BOTH not in status(health, 'fkm: orientation').message, PATIENCE), [
            status(health, name).message for name in (ENTRY, 'fkm: orientation')]
    assert first.stop() == 0
    assert fkm.stop() == 0
