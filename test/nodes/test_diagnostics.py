# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Levels by hysteresis, and dexterity from the latest orientation only."""

import os

from built_mechanism import random_built
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import SIM, stamp, status
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.kinematics.singularity import dexterity_without, nearness
from spm_haptic_master.nodes.dexterity_levels import Hysteresis, left_out, Levels
from spm_haptic_master.orientation_state import received_state
from spm_haptic_master.parameters.geometry import mounting_from, MOUNTING_SETTINGS
from spm_haptic_master.ros.duplicate_publishers import CURE
from spm_haptic_master.ros.overload import TOO_BUSY
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation import trajectories
from std_msgs.msg import Float64MultiArray, String

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def levels(etas, hysteresis):
    """Return the levels along a sequence of dexterities that begins OK."""
    level, found = OK, []
    for eta in etas:
        level = hysteresis.level(eta, level)
        found.append(level)
    return found


def test_levels_are_entered_below_and_left_above():
    hysteresis = Hysteresis(warn=0.06, error=0.03, margin=0.1)
    assert levels([0.07, 0.059, 0.065, 0.067], hysteresis) == [OK, WARN, WARN, OK]
    assert levels([0.029, 0.032, 0.034, 0.0299], hysteresis) == [ERROR, ERROR, WARN, ERROR]
    assert levels([0.0, 0.1], hysteresis) == [ERROR, OK]


def test_noise_at_a_threshold_changes_the_level_once():
    rng = np.random.default_rng(7)
    noisy = 0.059 + rng.uniform(-0.002, 0.002, 1000)
    changes = np.diff([level[0] for level in levels(noisy, Hysteresis(0.059, 0.033, 0.1))])
    assert np.count_nonzero(changes) <= 1


def test_thresholds_in_the_wrong_order_are_refused():
    with pytest.raises(SettingError, match='dexterity_error'):
        Hysteresis(warn=0.03, error=0.06, margin=0.1)


@pytest.mark.parametrize('trajectory', [
    trajectories.sweep(np.radians(20.0)), trajectories.hand, trajectories.fig9])
def test_two_minutes_of_a_healthy_device_are_ok(trajectory):
    """The fourth sensor copes with the singularity, which the message reports all the same."""
    along, crossings = Levels(Hysteresis(0.059, 0.033, 0.1)), set()
    for seconds in np.arange(0.0, 120.0, 0.05):
        quaternion = quaternion_from_matrix(matrix_from_zxz(*trajectory(seconds)))
        found = nearness(tuple(quaternion.tolist()), Geometry(), (1, 1, 1))
        crossings.add(along.take(found.three, found.every))
        assert along.level == OK, seconds
    assert crossings == {'clear of singularities',
                         'near a parallel singularity; the sensors in use cover it',
                         'at a parallel singularity; the sensors in use cover it'}


def test_the_level_is_that_of_the_sensors_in_use():
    along = Levels(Hysteresis(0.059, 0.033, 0.1))
    assert along.take(0.2, 0.05) == 'near a singularity of the sensors in use'
    assert along.level == WARN
    assert along.take(0.0, 0.01) == 'at a singularity of the sensors in use'
    assert along.level == ERROR
    assert along.take(0.034, 0.3) == 'at a parallel singularity; the sensors in use cover it'
    assert along.level == OK


@pytest.mark.parametrize(('state', 'sensors', 'expected'), [
    ('healthy', 4, ()), ('starting', 4, ()), ('silent: joint_3a frozen', 4, ()),
    ('degraded: joint_3a excluded', 4, (3,)), ('degraded: joint_3c missing', 6, (5,)),
    ('degraded: joint_1b excluded, joint_3b missing', 6, (1, 4)),
    ('degraded: joint_3b missing', 4, ()), ('degraded joint_3a', 4, ())])
def test_sensors_left_out_are_those_of_the_state(state, sensors, expected):
    assert left_out(received_state(state), sensors) == expected


def test_a_dexterity_without_sensors_is_that_of_the_rows_left():
    quaternion = tuple(quaternion_from_matrix(
        matrix_from_zxz(*np.radians([130.0, 50.0, 30.0]))).tolist())
    found = nearness(quaternion, Geometry(), (1, 1, 1), 6)
    arguments = quaternion, Geometry(), (1, 1, 1), 6
    assert dexterity_without(*arguments, (3, 4, 5)) == pytest.approx(found.three)
    assert dexterity_without(*arguments, ()) == pytest.approx(found.every)
    assert 0.0 < dexterity_without(*arguments, (0, 4, 5)) < found.every


@pytest.mark.process
def test_level_follows_the_orientation_and_silence_is_reported(start, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    dexterities = observer.collect(Float64MultiArray, 'dexterity')
    publisher = observer.node.create_publisher(QuaternionStamped, 'orientation', 10)
    state = observer.node.create_publisher(String, 'state', STATE)
    start('diagnostics')
    assert observer.spin_until(lambda: publisher.get_subscription_count() > 0, 60.0)

    def show(phi, seconds=0.5):
        message = QuaternionStamped()
        q = quaternion_from_matrix(matrix_from_zxz(*np.radians([135.0, 54.7356, phi])))
        for name, value in zip('xyzw', q, strict=True):
            setattr(message.quaternion, name, float(value))
        for _ in range(int(seconds / 0.01)):
            message.header.stamp = observer.node.get_clock().now().to_msg()
            publisher.publish(message)
            observer.spin(0.01)
        entry = status(health, 'diagnostics: singularity')
        return entry.level, entry.message, dexterities[-1][1].data[0]

    # Four sensors cope; the figure and the message are those of the three motor joints.
    far, near, at, off = show(20.0), show(53.5), show(49.36), show(30.0)
    assert [level for level, *_ in (far, near, at, off)] == [OK] * 4
    assert [text.partition(';')[0] for _, text, _ in (far, near, at, off)] == [
        'clear of singularities', 'near a parallel singularity', 'at a parallel singularity',
        'clear of singularities']
    assert far[2] > 0.059 > near[2] > 0.033 > at[2]
    # Without the fourth they do not.
    state.publish(String(data='degraded: joint_3a excluded'))
    assert [show(phi)[:2] for phi in (20.0, 53.5, 49.36, 30.0)] == [
        (OK, 'clear of singularities'), (WARN, 'near a singularity of the sensors in use'),
        (ERROR, 'at a singularity of the sensors in use'), (OK, 'clear of singularities')]
    # Words of another program: nobody knows which sensors are in use.
    state.publish(String(data='degraded joint_3a'))
    assert show(20.0)[:2] == (ERROR, "silent: unknown state 'degraded joint_3a'")
    state.publish(String(data='healthy'))
    assert show(49.36)[0] == OK

    count = len(dexterities)
    observer.spin(1.0)
    # An old orientation is not used again: at most the last one was still under way.
    assert len(dexterities) <= count + 2
    entry = status(health, 'diagnostics: singularity')
    assert (entry.level, entry.message) == (ERROR, 'no orientation')


@pytest.mark.process
@pytest.mark.parametrize('topic', ['orientation', 'measured_js'])
def test_two_publishers_are_an_error_and_no_dexterity_goes_out(start, observer, topic):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    dexterities = observer.collect(Float64MultiArray, 'dexterity')
    start('master', parameters={**SIM, 'sim.trajectory': 'fixed',
                                'sim.pose_deg': [135.0, 54.7356, 20.0]})
    start('diagnostics', '--ros-args', '-r', '__node:=apart')
    names = 'diagnostics: singularity', 'apart: singularity'

    def reported(level):
        return all((entry := status(health, name)) is not None and entry.level == level
                   for name in names)

    assert observer.spin_until(lambda: reported(OK), 60.0)
    rival = observer.node.create_publisher(
        QuaternionStamped if topic == 'orientation' else JointState, topic, 10)
    assert observer.spin_until(lambda: reported(ERROR), 60.0)
    owner = 'fkm' if topic == 'orientation' else 'encoder_driver'
    assert observer.spin_until(lambda: {status(health, name).message for name in names} == {
        f'2 publishers on /{topic}: /{owner}, /observer; {CURE}'}, 60.0)
    del dexterities[:]
    observer.spin(0.5)
    assert not dexterities
    observer.node.destroy_publisher(rival)
    assert observer.spin_until(lambda: reported(OK), 60.0)


@pytest.mark.process
@pytest.mark.parametrize(('rate', 'expected', 'words'), [
    (400.0, 200.0, 'more samples than expected'), (200.0, 400.0, 'samples missing')])
def test_a_rate_that_is_not_the_drivers_is_reported(start, observer, rate, expected, words):
    """In two processes, which cannot compare their parameters."""
    health = observer.collect(DiagnosticArray, '/diagnostics')
    start('fkm', parameters={'rate': expected, 'latency_limit': 1.0, 'max_age': 5.0})
    start('encoder_driver', parameters={**SIM, 'rate': rate})
    assert observer.spin_until(
        lambda: (entry := status(health, 'fkm: timing')) is not None
        and (entry.level, entry.message) == (WARN, words), 60.0)


@pytest.mark.process
@pytest.mark.alone
def test_overload_shows_as_such(start, start_python, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    master = start('master', parameters=SIM)
    assert observer.spin_until(lambda: status(health, 'fkm: timing') is not None, 60.0)
    # The master gets what three processes that want all of one core leave of it.
    core = min(os.sched_getaffinity(0))
    for _ in range(3):
        os.sched_setaffinity(start_python('-c', 'while True: pass').pid, {core})
    for thread in map(int, os.listdir(f'/proc/{master.pid}/task')):
        os.sched_setaffinity(thread, {core})
        os.setpriority(os.PRIO_PROCESS, thread, 19)
    with Disturbance() as machine:
        reported = observer.spin_until(
            lambda: status(health, 'fkm: timing').message.startswith(TOO_BUSY), 30.0)
    # Beside other programs, the master may not run at all.
    machine.expect(reported, status(health, 'fkm: timing'))
    entry = status(health, 'fkm: timing')
    values = {value.key: float(value.value) for value in entry.values}
    assert entry.level == WARN
    assert values['latency p99 (us)'] > 5000.0 or values['missed in the last second'] > 20.0


@pytest.mark.process
@pytest.mark.parametrize('mounted', [False, True], ids=['bare', 'mounted'])
def test_all_nine_joints_are_those_of_the_orientation(start, observer, mounted):
    """Of the mechanism as built, and without the mounting: the joints know no table."""
    built = random_built(np.random.default_rng(3), 0.2)
    mechanism = {'geometry.base_axes': built.base.ravel().tolist(),
                 'geometry.platform_axes': built.platform.ravel().tolist(),
                 'geometry.proximal_deg': np.degrees(built.alpha).tolist(),
                 'geometry.distal_deg': np.degrees(built.beta).tolist()}
    mounting = Mounting()
    if mounted:
        mechanism |= {'mounting.base_zxz_deg': [90.0, 0.0, 0.0],
                      'mounting.handle_zxz_deg': [0.0, 30.0, 0.0]}
        mounting = mounting_from({setting.name: mechanism[setting.name]
                                  for setting in MOUNTING_SETTINGS})
    joints = observer.collect(JointState, 'joint_states')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    start('master', parameters={**SIM, 'rate': 200.0, 'sim.trajectory': 'sweep', **mechanism})
    assert observer.spin_until(lambda: len(joints) > 50, 60.0)
    by_stamp = {stamp(message): message.quaternion for _, message in orientations}
    compared = [(by_stamp[stamp(message)], message) for _, message in joints
                if stamp(message) in by_stamp]
    assert len(compared) > 30
    for q, message in compared:
        assert message.name == list(MECHANISM_JOINT_NAMES)
        rotation = matrix_from_quaternion(mounting.unmounted((q.x, q.y, q.z, q.w)))
        # Each leg carries the platform there: by formulas of the tests' own.
        for k in range(3):
            carried = built.chain(k, *message.position[3 * k:3 * k + 3])
            assert np.abs(carried - rotation).max() < 1e-9


@pytest.mark.process
def test_no_orientation_no_joints(start, observer):
    joints = observer.collect(JointState, 'joint_states')
    publisher = observer.node.create_publisher(QuaternionStamped, 'orientation', 10)
    start('diagnostics', parameters={'joint_states_rate': 200.0})
    assert observer.spin_until(lambda: publisher.get_subscription_count() > 0, 60.0)
    message = QuaternionStamped()
    q = quaternion_from_matrix(matrix_from_zxz(*np.radians([135.0, 54.7356, 20.0])))
    for name, value in zip('xyzw', q, strict=True):
        setattr(message.quaternion, name, float(value))

    def shown():
        publisher.publish(message)
        return joints

    assert observer.spin_until(shown, 60.0)
    observer.spin(0.5)
    del joints[:]
    # One orientation is shown once; one out of reach, or none of a rotation, never.
    publisher.publish(message)
    assert observer.spin_until(lambda: len(joints) == 1, 60.0)
    message.quaternion.w = 2.0
    publisher.publish(message)
    publisher.publish(QuaternionStamped())
    observer.spin(0.5)
    assert len(joints) == 1
