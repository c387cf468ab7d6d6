# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The one-command use: master with the simulated source, its status, its end."""

from math import radians
from pathlib import Path
import re
import signal
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    TwistStamped,
)
from harness import complaints, ROOT, SIM, stamp, start_command, status
import numpy as np
import pytest
import rclpy
from recording import quaternions, rotation_angle
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import (
    private_environment,
    wait_until,
)
from spm_haptic_master.exceptions import RivalError
from spm_haptic_master.kinematics import (
    dexterity,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    zxz_from_matrix,
)
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros import duplicate_publishers
from spm_haptic_master.ros.diagnostic_status import CAUTION_KEY
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation.trajectories import CENTRE_PSI, CENTRE_THETA
from spm_haptic_master.supervision.exposure import UNCONFIRMED
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
LINE = re.compile(
    r'psi +[-\d.]+ theta +[-\d.]+ phi +(?P<phi>[-\d.]+) deg, '
    r'protection level (?P<protection>[\d.]+) deg, (.*, )?'
    r'dexterity (?P<three>[\d.]+) \(3 sensors\) (?P<four>[\d.]+) \(4 sensors\) '
    r'(?P<level>OK|WARN|ERROR) .*, joints (?P<joints>\d+) Hz orientation (?P<rate>\d+) Hz, '
    r'latency p50 (?P<p50>\d+) us p99 (?P<p99>\d+) us')


@pytest.mark.parametrize('number', [
    signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.evidence)])
def test_status_line_a_second_and_a_clean_end(start, number):
    master = start('master', parameters={
        **SIM, 'sim.trajectory': 'fixed', 'sim.pose_deg': [135.0, 54.7356, 45.0]})

    def shown():
        return [match.groupdict() for match in LINE.finditer(master.stdout)]

    # Two lines, and one of a second in which a busy machine let it work.
    assert wait_until(lambda: len(shown()) >= 2 and int(shown()[-1]['rate']) > 500, PATIENCE)
    assert master.stop(number) == 0
    assert complaints(master) == ''
    # No remark on a motion that is clear of the singularity, nor on what is not installed.
    assert master.stdout.startswith('haptic master, source sim (Ctrl-C ends)\nsource sim, ')
    assert 'crtk_msgs' not in master.stdout + master.stderr
    found = shown()
    assert float(found[0]['phi']) == pytest.approx(45.0, abs=0.5)
    assert 0.0 < float(found[0]['three']) < 0.1 < 0.3 < float(found[0]['four']) < 0.6
    assert 0 < int(found[-1]['p50']) <= int(found[-1]['p99'])


def test_a_second_master_leaves_the_first_alone_and_says_what_to_do(start, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    states = observer.collect(String, 'state', STATE)
    first = start('master', parameters=SIM)
    assert observer.spin_until(lambda: len(orientations) > 100, PATIENCE)
    del states[:]
    with Disturbance(BESIDE_OTHERS) as machine:
        second, began = start('master', parameters=SIM), time.monotonic()
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
    # It ends while it waits, and goes on where the first has ended.
    code, waited = second.stop(signal.SIGINT), time.monotonic() - began
    if waited > duplicate_publishers.LONGEST_WAIT:
        pytest.skip(f'machine too busy: {waited:.0f} s for what takes 5')
    assert code == 0
    with Disturbance(BESIDE_OTHERS) as machine:
        third = start('master', parameters=SIM)
        found = observer.spin_until(lambda: 'already' in third.stderr, PATIENCE)
    machine.expect(found, third.stderr)
    assert first.stop() == 0
    del orientations[:]
    assert observer.spin_until(lambda: len(orientations) > 100, PATIENCE)
    assert third.stop() == 0


def test_it_waits_no_longer_than_for_a_process_that_was_killed(monkeypatch, observer):
    rival = observer.node.create_publisher(QuaternionStamped, 'orientation', 10)
    monkeypatch.setattr(duplicate_publishers, 'LONGEST_WAIT', 1.0)
    rclpy.init(domain_id=int(private_environment()['ROS_DOMAIN_ID']))
    try:
        with pytest.raises(RivalError, match='^/orientation is published by /observer already: '
                           'end that one, or start this one with another ROS_DOMAIN_ID '):
            duplicate_publishers.wait_until_alone({'fkm': 'orientation'}, lambda: False)
        observer.node.destroy_publisher(rival)
        duplicate_publishers.wait_until_alone({'fkm': 'orientation'}, lambda: False)
    finally:
        rclpy.shutdown()


def test_every_output_of_a_fixed_pose(start, observer):
    pose = [130.0, 50.0, 30.0]
    arrived = {topic: observer.collect(kind, topic) for topic, kind in {
        'measured_js': JointState, 'orientation': QuaternionStamped, 'measured_cp': PoseStamped,
        'pose_with_covariance': PoseWithCovarianceStamped, 'measured_cv': TwistStamped,
        'dexterity': Float64MultiArray, '/diagnostics': DiagnosticArray}.items()}
    start('master', parameters={
        **SIM, 'sim.trajectory': 'fixed', 'sim.pose_deg': pose, 'sim.noise_deg': 0.04,
        'rate': 250.0, 'crtk_rate': 0.0})  # a rate that a busy machine keeps up with
    assert observer.spin_until(lambda: len(arrived['measured_cv']) >= 1000, PATIENCE)
    rotation = matrix_from_zxz(*map(radians, pose))

    sample = arrived['measured_js'][-1][1]
    assert sample.name == list(JOINT_NAMES)
    assert len(sample.position) == 4

    got = quaternions(arrived['orientation'])
    error = rotation_angle(got, np.asarray(quaternion_from_matrix(rotation)))
    assert np.sqrt(np.mean(error ** 2)) < 0.06
    assert np.all(np.diff([stamp(m) for _, m in arrived['orientation']]) > 0)

    last = arrived['orientation'][-1][1]
    same = {topic: next((message for _, message in arrived[topic]
                         if message.header.stamp == last.header.stamp), None)
            for topic in ('measured_cp', 'pose_with_covariance')}
    if same['measured_cp'] is not None:
        assert same['measured_cp'].pose.orientation == last.quaternion
    for topic in ('measured_cp', 'pose_with_covariance', 'measured_cv'):
        assert arrived[topic][-1][1].header.frame_id == last.header.frame_id == 'spm_base'

    covariance = np.array(arrived['pose_with_covariance'][-1][1].pose.covariance).reshape(6, 6)
    assert np.all(covariance[:3] == 0.0)
    assert np.all(covariance[:, :3] == 0.0)
    # The covariance is the scatter that the orientations really have, about the fixed axes.
    predicted = np.degrees(np.sqrt(np.trace(covariance[3:, 3:])))
    assert np.sqrt(np.mean(error ** 2)) == pytest.approx(predicted, rel=0.1)

    angular = np.array([[m.twist.angular.x, m.twist.angular.y, m.twist.angular.z]
                        for _, m in arrived['measured_cv']])
    assert np.abs(angular.mean(axis=0)).max() < 0.02

    near = arrived['dexterity'][-1][1]
    assert near.layout.dim[0].size == 2
    expected = [float(dexterity(rotation, sensors=sensors)) for sensors in (3, 4)]
    assert list(near.data) == pytest.approx(expected, abs=0.005)

    for name, message in {'encoder_driver: encoders': 'publishing [sim]',
                          'fkm: orientation': f'healthy; {UNCONFIRMED}',
                          'diagnostics: singularity': 'clear of singularities'}.items():
        # For a while the machine may have been too busy.
        assert observer.spin_until(lambda n=name, m=message: (
            entry := status(arrived['/diagnostics'], n)) is not None and entry.message == m,
            PATIENCE)
        entry = status(arrived['/diagnostics'], name)
        # Four sensors of a device that rests are not checked.
        assert entry.level == (
            DiagnosticStatus.WARN if name == 'fkm: orientation' else DiagnosticStatus.OK)
        values = {value.key: value.value for value in entry.values}
        assert values and values.get(CAUTION_KEY, UNCONFIRMED) == UNCONFIRMED
        assert (CAUTION_KEY in values) == (name == 'fkm: orientation')


def test_angular_velocity_of_a_turn(start, observer):
    # At 50 Hz a period is as long as the window of the angular velocity.
    rate, count = 50.0, 100
    twists = observer.collect(TwistStamped, 'measured_cv')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    start('master', parameters={
        **SIM, 'sim.noise_deg': 0.0, 'rate': rate, 'crtk_rate': 0.0})
    assert observer.spin_until(lambda: len(twists) >= count, PATIENCE)
    # Fig. 9 turns about the platform axis, phi = 45 + 10 sin(pi t / 10) deg: its speed follows
    # from phi, whenever the first message arrived.
    axis = matrix_from_zxz(CENTRE_PSI, CENTRE_THETA, 0.0)[:, 2]
    angular = np.array([[m.twist.angular.x, m.twist.angular.y, m.twist.angular.z]
                        for _, m in twists])
    along = angular @ axis
    q = [(m.quaternion.x, m.quaternion.y, m.quaternion.z, m.quaternion.w)
         for _, m in orientations]
    phi = np.degrees(zxz_from_matrix(matrix_from_quaternion(q))[2])
    speeds = dict(zip(map(stamp, (m for _, m in orientations)),
                      np.pi * np.sqrt(np.maximum(1.0 - ((phi - 45.0) / 10.0) ** 2, 0.0)),
                      strict=True))
    pairs = [(abs(np.degrees(each)), speeds[stamp(m)])
             for each, (_, m) in zip(along, twists, strict=True) if stamp(m) in speeds]
    assert len(pairs) > 0.5 * count
    # The median: a stall of the machine makes the stamps around it uneven.
    measured, true = np.median(pairs, axis=0)
    assert measured == pytest.approx(true, rel=0.25)
    assert np.degrees(np.abs(angular - np.outer(along, axis)).mean()) < 0.3


def test_arguments_without_ros_args_reach_the_nodes_and_names_go_with_the_namespace(
        start, observer):
    arrived = observer.collect(QuaternionStamped, '/left/orientation')
    health = observer.collect(DiagnosticArray, '/diagnostics')
    program = start('master', '-p', 'source:=sim', '-r', '__ns:=/left', '-p', 'rate:=200.0')
    assert observer.spin_until(
        lambda: len(arrived) > 20 and status(health, 'left/fkm: orientation'), PATIENCE)
    assert program.stop() == 0


def test_silence_where_simulated_time_stands_still_has_a_reason(start, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    start('master', parameters={**SIM, 'use_sim_time': True})
    assert observer.spin_until(
        lambda: (entry := status(health, 'fkm: orientation')) is not None
        and entry.message == 'silent: sample from the future', PATIENCE)
    assert orientations == []


def test_a_filter_between_driver_and_fkm_is_not_passed_by(start, observer):
    """With the topic remapped for one of them, fkm takes what stands on it, and only that."""
    raw = observer.collect(JointState, 'measured_js')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    filtered = observer.node.create_publisher(JointState, 'filtered_js', 10)
    start('master', '--ros-args', '-r', 'fkm:measured_js:=filtered_js',
          parameters={**SIM, 'rate': 100.0})
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


@pytest.mark.skipif(Path(sys.prefix) != ROOT / '.venv', reason='not in the .venv of make')
def test_make_run_says_so_when_a_parameter_is_wrong():
    make = start_command(['make', '-s', 'run', 'ARGS=--ros-args -p source:=nothing'])
    assert make.wait(2.0 * PATIENCE) != 0
    assert "parameter 'source' is 'nothing'; expected one of can, replay, sim" in make.stderr
