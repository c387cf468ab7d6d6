# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Levels by hysteresis, and dexterity from the latest orientation only."""

import os

from built_mechanism import random_built
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import Disturbance
from geometry_msgs.msg import Quaternion, QuaternionStamped
from harness import SIM, stamp, status
import numpy as np
import pytest
from recording import quaternions
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.jacobians import dexterity_without, nearness
from spm_haptic_master.kinematics.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.nodes.dexterity_levels import Levels
from spm_haptic_master.parameters.geometry import (
    GEOMETRY_SETTINGS,
    mechanism_checksum,
    mounting_from,
    MOUNTING_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.nodes import DIAGNOSTICS_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros.duplicate_publishers import CURE
from spm_haptic_master.ros.overload import TOO_BUSY
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation import trajectories
from std_msgs.msg import Float64MultiArray, String

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


THRESHOLDS = {'dexterity_warn': 0.06, 'dexterity_error': 0.03, 'dexterity_hysteresis': 0.1}


@pytest.mark.parametrize(('etas', 'expected'), [
    ([0.07, 0.06, 0.059, 0.065, 0.067], [OK, OK, WARN, WARN, OK]),
    ([0.03, 0.029, 0.032, 0.034, 0.0299], [WARN, ERROR, ERROR, WARN, ERROR]),
    ([0.0, 0.065, 0.1], [ERROR, WARN, OK])])
def test_levels_are_entered_below_and_left_above(etas, expected):
    """Of the sensors in use, and of the three active joints where those in use are enough."""
    texts = {OK: 'clear of singularities',
             WARN: 'near a parallel singularity; the sensors in use cover it',
             ERROR: 'at a parallel singularity; the sensors in use cover it'}
    along, covered = Levels(THRESHOLDS), Levels(THRESHOLDS)
    for eta, level in zip(etas, expected, strict=True):
        text = along.take(0.2, eta)
        assert along.level == level
        assert text == {**texts, WARN: 'near a singularity of the sensors in use',
                        ERROR: 'at a singularity of the sensors in use'}[level]
        assert (covered.take(eta, 0.3), covered.level) == (texts[level], OK)


def test_thresholds_in_the_wrong_order_are_refused_and_change_nothing():
    along = Levels(THRESHOLDS)
    with pytest.raises(SettingError, match="'dexterity_error' is 0.07; expected .* at most"):
        along.use({**THRESHOLDS, 'dexterity_error': 0.07})
    along.use({**THRESHOLDS, 'dexterity_error': 0.06})
    along.take(0.2, 0.059)
    assert along.level == ERROR


@pytest.mark.parametrize('trajectory', [
    trajectories.sweep(np.radians(20.0)), trajectories.hand, trajectories.fig9])
def test_two_minutes_of_a_healthy_device_are_ok(trajectory):
    """The fourth sensor copes with the singularity, which the message reports all the same."""
    along, crossings = Levels(complete(DIAGNOSTICS_SETTINGS, {})), set()
    for seconds in np.arange(0.0, 120.0, 0.05):
        quaternion = quaternion_from_matrix(matrix_from_zxz(*trajectory(seconds)))
        found = nearness(tuple(quaternion.tolist()), Geometry(), (1, 1, 1))
        crossings.add(along.take(found.three, found.every))
        assert along.level == OK, seconds
    assert len(crossings) == 3


def test_a_dexterity_without_sensors_is_that_of_the_rows_left():
    quaternion = tuple(quaternion_from_matrix(
        matrix_from_zxz(*np.radians([130.0, 50.0, 30.0]))).tolist())
    arguments = quaternion, Geometry(), (1, 1, 1), 6
    found = nearness(*arguments)
    assert dexterity_without(*arguments, (3, 4, 5)) == pytest.approx(found.three)
    assert dexterity_without(*arguments, ()) == pytest.approx(found.every)
    assert 0.0 < dexterity_without(*arguments, (0, 4, 5)) < found.every


@pytest.mark.process
def test_level_and_joints_follow_the_orientation_and_silence_is_reported(start, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    dexterities = observer.collect(Float64MultiArray, 'dexterity')
    joints = observer.collect(JointState, 'joint_states')
    publisher = observer.node.create_publisher(QuaternionStamped, 'orientation', 10)
    state = observer.node.create_publisher(String, 'state', STATE)
    start('diagnostics', parameters={'joint_states_rate': 200.0})
    assert observer.spin_until(lambda: publisher.get_subscription_count() > 0, PATIENCE)
    message = QuaternionStamped()

    def send(phi):
        q = quaternion_from_matrix(matrix_from_zxz(*np.radians([135.0, 54.7356, phi])))
        for name, value in zip('xyzw', q, strict=True):
            setattr(message.quaternion, name, float(value))
        publisher.publish(message)

    def entry():
        found = status(health, 'diagnostics: singularity')
        return found and (found.level, found.message.partition(';')[0])

    def expect(phi, level, text):
        assert observer.spin_until(
            lambda: send(phi) or entry() == (level, text) and dexterities, PATIENCE), entry()
        del dexterities[:]
        assert observer.spin_until(lambda: send(phi) or len(dexterities) > 2, PATIENCE)
        return dexterities[-1][1].data[0]

    # Four sensors cope; the figure and the message are those of the three motor joints.
    far, near, at = (expect(phi, OK, text) for phi, text in (
        (20.0, 'clear of singularities'), (53.5, 'near a parallel singularity'),
        (49.36, 'at a parallel singularity')))
    assert far > 0.059 > near > 0.033 > at
    # Without the fourth they do not; a sensor that there is not changes nothing.
    for text, phi, level, words in (
            ('degraded: joint_3b missing', 20.0, OK, 'clear of singularities'),
            ('degraded: joint_3a excluded', 49.36, ERROR,
             'at a singularity of the sensors in use'),
            ('degraded: joint_3a excluded', 53.5, WARN,
             'near a singularity of the sensors in use'),
            ('healthy', 49.36, OK, 'at a parallel singularity')):
        state.publish(String(data=text))
        expect(phi, level, words)
    # Words of another program: nobody knows which sensors are in use.
    state.publish(String(data='degraded joint_3a'))
    assert observer.spin_until(
        lambda: send(20.0) or entry() == (ERROR, "silent: unknown state 'degraded joint_3a'"),
        PATIENCE)
    state.publish(String(data='healthy'))
    expect(20.0, OK, 'clear of singularities')

    # An old orientation is not used again.
    assert observer.spin_until(lambda: entry() == (ERROR, 'no orientation'), PATIENCE)
    del dexterities[:], joints[:]
    observer.spin(0.5)
    assert not dexterities and not joints
    send(20.0)
    assert observer.spin_until(lambda: joints and dexterities, PATIENCE)
    # One out of reach, or none of a rotation, is never shown.
    for quaternion in (Quaternion(x=1.0, w=0.0), Quaternion(w=2.0), Quaternion(w=float('nan'))):
        message.quaternion = quaternion
        publisher.publish(message)
        assert observer.spin_until(lambda: entry()[0] == ERROR, PATIENCE)
        observer.spin(0.1)
    assert len(joints) == len(dexterities) == 1


@pytest.mark.process
def test_two_publishers_are_named_by_each_node_and_nothing_goes_out(start, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    arrived = {topic: observer.collect(kind, topic) for topic, kind in (
        ('dexterity', Float64MultiArray), ('orientation', QuaternionStamped))}
    states = observer.collect(String, 'state', STATE)
    start('master', parameters={**SIM, 'sim.trajectory': 'fixed',
                                'sim.pose_deg': [135.0, 54.7356, 20.0]})
    start('diagnostics', '--ros-args', '-r', '__node:=apart')
    both = ('diagnostics: singularity', 'apart: singularity')

    def report(level, words, *names):
        return observer.spin_until(lambda: all(
            (entry := status(health, name)) is not None and entry.level == level
            and words in entry.message for name in names), PATIENCE)

    for topic, kind, owner, more in (
            ('orientation', QuaternionStamped, 'fkm', []),
            ('measured_js', JointState, 'encoder_driver', ['encoder_driver: encoders'])):
        assert report(OK, '', *both, *more)
        rival = observer.node.create_publisher(kind, topic, 10)
        words = f'2 publishers on /{topic}: /{owner}, /observer; {CURE}'
        assert report(ERROR, words, *both, *more, 'fkm: orientation')
        assert observer.spin_until(
            lambda words=words: states[-1][1].data == f'silent: {words}', PATIENCE)
        for messages in arrived.values():
            messages.clear()
        observer.spin(0.5)
        assert arrived == {'dexterity': [], 'orientation': []}
        observer.node.destroy_publisher(rival)
        assert observer.spin_until(lambda: all(arrived.values()), PATIENCE)


@pytest.mark.process
@pytest.mark.alone
def test_overload_shows_as_such(start, start_python, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    master = start('master', parameters=SIM)
    assert observer.spin_until(lambda: status(health, 'fkm: timing') is not None, PATIENCE)
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
def test_all_nine_joints_are_those_of_the_orientation(start, observer):
    """Of the mechanism as built in all nodes; and the joints know no table."""
    built = random_built(np.random.default_rng(3), 0.2)
    mechanism = {'geometry.base_axes': built.base.ravel().tolist(),
                 'geometry.platform_axes': built.platform.ravel().tolist(),
                 'geometry.proximal_deg': np.degrees(built.alpha).tolist(),
                 'geometry.distal_deg': np.degrees(built.beta).tolist()}
    table = {'mounting.base_zxz_deg': [90.0, 0.0, 0.0],
             'mounting.handle_zxz_deg': [0.0, 30.0, 0.0]}
    mounting = mounting_from({each.name: table[each.name] for each in MOUNTING_SETTINGS})
    joints, orientations, truths, health = (observer.collect(kind, topic) for kind, topic in (
        (JointState, 'joint_states'), (QuaternionStamped, 'orientation'),
        (QuaternionStamped, 'ground_truth/orientation'), (DiagnosticArray, '/diagnostics')))
    start('master', parameters={
        **SIM, 'rate': 200.0, 'sim.trajectory': 'sweep', **mechanism, **table})
    assert observer.spin_until(lambda: len(joints) > 50, PATIENCE)
    known = {stamp(message): matrix_from_quaternion(mounting.unmounted(
        (message.quaternion.x, message.quaternion.y, message.quaternion.z, message.quaternion.w)))
        for _, message in orientations}
    shown = [message for _, message in joints if stamp(message) in known]
    assert len(shown) > 30
    for message in shown:
        assert message.name == list(MECHANISM_JOINT_NAMES)
        # Each leg carries the platform there: by formulas of the tests' own.
        for k in range(3):
            carried = built.chain(k, *message.position[3 * k:3 * k + 3])
            assert np.abs(carried - known[stamp(message)]).max() < 1e-9
    # The simulated rig is the mechanism as built, too.
    true = [(known[stamp(message)], quaternions([(0, message)])[0]) for _, message in truths
            if stamp(message) in known]
    assert len(true) > 30
    off = [np.linalg.norm(found - matrix_from_quaternion(q)) for found, q in true]
    assert np.degrees(max(off)) / np.sqrt(2.0) < 0.3

    def checksums():
        entries = [status(health, name) for name in (
            'encoder_driver: encoders', 'fkm: orientation', 'diagnostics: singularity')]
        return [{each.key: each.value for each in entry.values}.get('mechanism')
                for entry in entries if entry is not None]

    assert observer.spin_until(lambda: None not in checksums() and len(checksums()) == 3, PATIENCE)
    settings = (*GEOMETRY_SETTINGS, WORKING_MODE_SETTING)
    own = mechanism_checksum(complete(settings, mechanism))
    assert checksums() == [own] * 3 and own != mechanism_checksum(complete(settings, {}))
