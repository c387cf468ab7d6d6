# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The one-command use: master with the simulated source, its outputs, its status, its end."""

from math import radians
import re
import signal

from diagnostic_msgs.msg import DiagnosticArray
from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import PoseStamped, QuaternionStamped
from harness import complaints, SIM, stamp, status
import numpy as np
import pytest
from recording import quaternions, rotation_angle
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import dexterity, matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.supervision.exposure import UNCONFIRMED
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
LINE = re.compile(
    r'state healthy, .*orientation psi +[-\d.]+ theta +[-\d.]+ phi +(?P<phi>[-\d.]+) deg, '
    r'protection level [\d.]+ deg, .*dexterity [\d.]+ \(3 sensors\), [\d.]+ \(4 sensors\), '
    r'rates joints \d+ Hz, orientation (?P<rate>\d+) Hz, '
    r'latency p50 (?P<p50>\d+) us, p99 (?P<p99>\d+) us')


def test_outputs_and_status_of_a_fixed_pose_and_a_clean_end(start, observer):
    pose = [130.0, 50.0, 30.0]
    arrived = {topic: observer.collect(kind, topic) for topic, kind in {
        'measured_js': JointState, 'orientation': QuaternionStamped, 'measured_cp': PoseStamped,
        'dexterity': Float64MultiArray, '/diagnostics': DiagnosticArray}.items()}
    operating = observer.collect(String, 'operating_state_text', STATE)
    master = start('master', parameters={
        **SIM, 'sim.trajectory': 'fixed', 'sim.pose_deg': pose, 'sim.noise_deg': 0.04,
        'rate': 250.0})  # a rate that a busy machine keeps up with

    def shown():
        return [match.groupdict() for match in LINE.finditer(master.stdout)]

    # Two lines, and one of a second in which a busy machine let it work.
    assert observer.spin_until(
        lambda: len(shown()) >= 2 and int(shown()[-1]['rate']) > 125
        and all(arrived.values()), PATIENCE)
    rotation = matrix_from_zxz(*map(radians, pose))
    assert arrived['measured_js'][-1][1].name == list(JOINT_NAMES)
    error = rotation_angle(quaternions(arrived['orientation']),
                           np.asarray(quaternion_from_matrix(rotation)))
    assert np.sqrt(np.mean(error ** 2)) < 0.06
    assert np.all(np.diff([stamp(m) for _, m in arrived['orientation']]) > 0)
    for topic in ('orientation', 'measured_cp'):
        assert arrived[topic][-1][1].header.frame_id == 'spm_base'
    expected = [float(dexterity(rotation, sensors=sensors)) for sensors in (3, 4)]
    assert list(arrived['dexterity'][-1][1].data) == pytest.approx(expected, abs=0.005)
    for name, message in {'encoder_driver: encoders': 'publishing [sim]',
                          'fkm: orientation': f'healthy; {UNCONFIRMED}',
                          'diagnostics: singularity': 'clear of singularities'}.items():
        # For a while the machine may have been too busy.
        assert observer.spin_until(lambda n=name, m=message: (
            entry := status(arrived['/diagnostics'], n)) is not None and entry.message == m,
            PATIENCE)
    assert master.stop(signal.SIGINT) == 0
    assert complaints(master) == ''
    assert observer.spin_until(lambda: operating[-1][1].data == 'FAULT', 5.0)
    # No remark on a motion that is clear of the singularity, nor on what is not installed.
    assert master.stdout.startswith('haptic master, source sim (Ctrl-C ends)\nsource sim, ')
    assert 'crtk_msgs' not in master.stdout + master.stderr
    found = shown()
    assert float(found[0]['phi']) == pytest.approx(30.0, abs=0.5)
    assert 0 < int(found[-1]['p50']) <= int(found[-1]['p99'])


def test_a_second_master_leaves_the_first_alone_and_goes_on_where_that_has_ended(start, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    states = observer.collect(String, 'state', STATE)
    first = start('master', parameters=SIM)
    assert observer.spin_until(lambda: len(orientations) > 100, PATIENCE)
    del states[:]
    with Disturbance(BESIDE_OTHERS) as machine:
        second = start('master', parameters=SIM)
        found = observer.spin_until(
            lambda: '/orientation is published by /fkm already: end that one, or start this one '
            'with another ROS_DOMAIN_ID' in second.stderr, PATIENCE)
    machine.expect(found, second.stderr)
    # DDS may have the publisher for a moment before the name of its node.
    assert len([line for line in second.stderr.splitlines() if 'without a name' not in line]) == 1
    del orientations[:]
    assert observer.spin_until(lambda: len(orientations) > 100, PATIENCE)
    assert observer.node.count_publishers('orientation') == 1
    assert not any('publishers on' in message.data for _, message in states)
    assert first.stop() == 0
    del orientations[:]
    assert observer.spin_until(lambda: len(orientations) > 100, PATIENCE)
    assert second.stop() == 0


def test_a_filter_between_driver_and_fkm_is_not_passed_by(start, observer):
    """With the topic remapped for one of them; in a namespace, without --ros-args."""
    raw = observer.collect(JointState, '/left/measured_js')
    orientations = observer.collect(QuaternionStamped, '/left/orientation')
    filtered = observer.node.create_publisher(JointState, '/left/filtered_js', 10)
    program = start('master', '-p', 'source:=sim', '-r', '__ns:=/left', '-p', 'rate:=100.0',
                    '-r', 'fkm:measured_js:=filtered_js')
    assert observer.spin_until(
        lambda: len(raw) > 50 and filtered.get_subscription_count() > 0, PATIENCE)
    assert orientations == []
    sent = {}

    def passes_on():
        while raw:
            _, sample = raw.pop(0)
            if len(sent) < 100:
                filtered.publish(sample)
                sent[stamp(sample)] = sample
        return len(orientations) >= 90

    raw.clear()
    assert observer.spin_until(passes_on, PATIENCE)
    assert {stamp(message) for _, message in orientations} <= sent.keys()
    assert program.stop() == 0
