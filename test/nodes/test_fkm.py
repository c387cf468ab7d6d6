# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What fkm publishes, and when it keeps silent and says why."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import Observer, stamp, start_program, status
import numpy as np
import pytest
from rclpy.duration import Duration
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import inverse, matrix_from_quaternion, matrix_from_zxz
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

NAMES = list(JOINT_NAMES)
POSE = matrix_from_zxz(*np.radians([130.0, 50.0, 30.0]))


def angles(rotation=POSE) -> list[float]:
    """Return what the four sensors say at a pose."""
    joints = inverse(rotation)
    return [*map(float, joints.theta1), float(joints.theta3a)]


@pytest.fixture(scope='module')
def process():
    """One fkm for all tests: what one of them sends must not spoil the next."""
    program, observer = start_program('fkm', parameters={
        # A sample of a busy machine is not to be stale, and each sensor is checked at this pose:
        # else a fault of it is not cleared here.
        'frame_id': 'base_of_the_test', 'recovery': 0.2, 'max_age': 1.0,
        'alert_limit_deg': 5.0}), Observer()
    yield Rig(observer)
    observer.close()
    assert program.stop() == 0


@pytest.fixture
def rig(process):
    """Return a running fkm, with this test in the place of the encoder driver."""
    process.orientations.clear()
    process.health.clear()
    return process


class Rig:

    def __init__(self, observer):
        self.observer = observer
        self.orientations = observer.collect(QuaternionStamped, 'orientation')
        self.health = observer.collect(DiagnosticArray, '/diagnostics')
        self.publisher = observer.node.create_publisher(JointState, 'measured_js', 10)
        assert observer.spin_until(
            lambda: self.publisher.get_subscription_count() > 0
            and observer.node.count_publishers('orientation') > 0, 15.0)
        observer.spin(0.3)

    def send(self, position, names=NAMES, offset=0.0):
        """Publish a sample stamped now + offset s; return it and what answered it so far."""
        now = self.observer.node.get_clock().now() + Duration(seconds=offset)
        message = JointState(name=names, position=position)
        message.header.stamp = now.to_msg()
        self.publisher.publish(message)
        self.observer.spin_until(lambda: self.answers(message), 0.1)
        return message, self.answers(message)

    def answers(self, *samples):
        """Return the orientations of samples; others may come late on a busy machine."""
        sent = {stamp(sample) for sample in samples}
        return [m for _, m in self.orientations if stamp(m) in sent]

    def qualify(self, position=None):
        """Send one pose until fkm trusts the sensors."""
        position = angles() if position is None else position
        assert any(self.send(position)[1] for _ in range(200)), self.reason()

    def send_some(self, *args, **kwargs):
        """Send ten samples and return every answer."""
        return self.answers(*[self.send(*args, **kwargs)[0] for _ in range(10)])

    def reason(self) -> str:
        """Return what fkm says of its silence."""
        del self.health[:]
        assert self.observer.spin_until(
            lambda: status(self.health, 'fkm: orientation') is not None, 3.0)
        entry = status(self.health, 'fkm: orientation')
        assert entry.level == DiagnosticStatus.ERROR
        return entry.message + ' / ' + ' '.join(
            value.value for value in entry.values if value.key == 'last rejected')


def test_a_good_sample_gives_its_orientation(rig):
    rig.qualify()
    sample, (orientation,) = rig.send(angles())
    assert orientation.header.frame_id == 'base_of_the_test'
    assert stamp(orientation) == stamp(sample)
    q = orientation.quaternion
    np.testing.assert_allclose(
        matrix_from_quaternion([q.x, q.y, q.z, q.w]), POSE, atol=1e-12)


@pytest.mark.parametrize(('position', 'names', 'reason'), [
    (angles()[:3], NAMES[:3], 'misnamed'),
    (angles()[:3], NAMES, 'incomplete'),
    ([*angles(), 0.0], NAMES, 'incomplete'),
    ([], NAMES, 'incomplete'),
    ([*angles()[:3], float('nan')], NAMES, 'not finite'),
    ([float('inf'), *angles()[1:]], NAMES, 'not finite'),
    ([float('inf'), float('-inf'), *angles()[2:]], NAMES, 'not finite'),
    (angles(), [NAMES[0], NAMES[2], NAMES[1], NAMES[3]], 'misnamed'),
    (angles(), [], 'misnamed'),
    (list(np.add(angles(), [0.0, 0.0, 0.0, np.radians(2.0)])), NAMES, 'silent: '),
    (list(np.add(angles(), [0.0, np.radians(2.0), 0.0, 0.0])), NAMES, 'silent: '),
    ([3.0, -3.0, 3.0, 0.0], NAMES, 'silent'),
])
def test_a_bad_sample_gives_silence_and_a_reason(rig, position, names, reason):
    rig.qualify()
    assert rig.send_some(position, names) == []
    assert reason in rig.reason()
    # And it does not spoil what follows.
    rig.qualify()


def test_another_rigs_calibration_is_suspected_where_no_orientation_fits(start, observer):
    fresh = start('fkm', '-r', '__ns:=/other', parameters={'max_age': 1.0})
    health = observer.collect(DiagnosticArray, '/diagnostics')
    publisher = observer.node.create_publisher(JointState, '/other/measured_js', 10)
    message = JointState(name=NAMES, position=[3.0, -3.0, 3.0, 0.0])

    def suspected():
        message.header.stamp = observer.node.get_clock().now().to_msg()
        publisher.publish(message)
        entry = status(health, 'other/fkm: orientation')
        return entry is not None and entry.message == (
            "silent: no orientation fits: the calibration may be another rig's, or no longer "
            'hold: calibrate --motion --check calibration.yaml')

    assert observer.spin_until(suspected, 60.0), fresh.stderr


def test_old_future_and_repeated_samples_give_silence(rig):
    rig.qualify()
    sample, answers = rig.send(angles())
    assert len(answers) == 1
    for _ in range(10):
        rig.publisher.publish(sample)
        rig.observer.spin(0.01)
    assert len(rig.answers(sample)) == 1
    assert 'not newer' in rig.reason()
    assert rig.send_some(angles(), offset=-3.0) == []
    assert 'stale' in rig.reason()
    assert rig.send_some(angles(), offset=3.0) == []
    assert 'future' in rig.reason()
    rig.qualify()


def test_silence_of_the_driver_is_reported(rig):
    rig.qualify()
    with Disturbance(BESIDE_OTHERS) as machine:
        rig.observer.spin(0.3)
        reason = rig.reason()
    machine.expect('silent: no joint samples' in reason, reason)


def test_the_quaternion_never_jumps_to_its_opposite(rig):
    rig.qualify(angles(matrix_from_zxz(*np.radians([135.0, 54.7356, 20.0]))))
    samples = []
    with Disturbance(BESIDE_OTHERS) as machine:
        for turn in np.linspace(0.0, 40.0, 30):
            pose = matrix_from_zxz(*np.radians([135.0, 54.7356, 20.0 + turn]))
            samples.append(rig.send(angles(pose))[0])
            rig.observer.spin(0.01)  # a hand's pace
        rig.observer.spin_until(lambda: len(rig.answers(*samples)) == len(samples), 5.0)
    got = np.array([[m.quaternion.x, m.quaternion.y, m.quaternion.z, m.quaternion.w]
                    for m in rig.answers(*samples)])
    machine.expect(len(got) == len(samples), len(got))
    assert np.all(np.sum(got[1:] * got[:-1], axis=1) > 0.99)
    # w crosses zero on the way (psi + phi = 180 deg), where a sign by w >= 0 would jump.
    assert np.ptp(np.sign(got[:, 3])) == 2.0


def test_state_is_told_to_a_controller_that_comes_later(rig):
    rig.qualify()
    late = Observer()
    states = late.collect(String, 'state', STATE)
    try:
        with Disturbance(BESIDE_OTHERS) as machine:
            assert late.spin_until(lambda: len(states) > 0, 60.0)
            first = states[-1][1].data
            rig.qualify()
            late.spin(0.5)
        machine.expect(first.startswith(('healthy', 'silent: no joint samples')), first)
        found = [message.data for _, message in states]
        machine.expect('healthy' in found, found)
        machine.expect(found[-1] == 'silent: no joint samples', found)
    finally:
        late.close()
