# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five and six sensors from the bus to the orientation, and one of them faulty."""

from math import radians

from geometry_msgs.msg import QuaternionStamped
from harness import SIM
import numpy as np
import pytest
from recording import quaternions, rotation_angle, SINGULAR_PHI, stamps
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.kinematics import zxz_quaternion
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.validation.recordings import read_joints
from std_msgs.msg import Float64MultiArray, String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# Pose of the simulation: the central singularity, where th3A alone of four sensors carries it.
POSE = (135.0, 54.735610317, SINGULAR_PHI)
# Time of the fault after the first answer, and to the time when nothing wrong goes out (s): the
# window, ten samples.
ONSET, ALERT = 4.0, 0.2
RATE = 100.0


@pytest.fixture
def session(start, observer, bus_channel, tmp_path):
    """Run N encoders of which that of th3A jumps by 2 deg; return what was published."""
    def run(sensors, last_state):
        bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel, 'rate': RATE}
        states = observer.collect(String, 'state', STATE)
        topics = [observer.collect(kind, name) for kind, name in (
            (QuaternionStamped, 'orientation'), (JointState, 'measured_js'),
            (Float64MultiArray, 'protection_level'))]
        recorder = start('recorder', parameters={'directory': tmp_path})
        start('fkm', parameters={'rate': RATE, 'sensors': sensors, 'sample_timeout': 2.0,
                                 'max_age': 1.0})
        start('encoder_driver', parameters={
            'source': 'can', 'can.sync': 'produce', 'can.timeout': 1.0, **simulated_rig(sensors),
            **bus})
        assert observer.spin_until(
            lambda: states and observer.node.count_publishers('measured_js'), PATIENCE)
        encoders = start(
            'sim_bus', *parameter_arguments(bus | {
                'sensors': sensors, 'sim.trajectory': 'fixed', 'sim.pose_deg': [*POSE]}),
            '--fault', f'offset:joint_3a@{ONSET:g}=2')
        texts = lambda: [message.data for _, message in states]  # noqa: E731
        assert observer.spin_until(lambda: last_state in ''.join(texts()), PATIENCE), \
            (texts(), encoders.stderr)
        observer.spin(1.0)
        assert recorder.stop() == 0
        (begins,) = (float(line.split()[0]) for line in encoders.stdout.splitlines()
                     if line.endswith('begins'))
        assert 'healthy' in texts()
        return begins, *topics
    return run


def wrong(orientations):
    """Return the errors of orientations, deg."""
    true = np.array([zxz_quaternion(*map(radians, POSE))])
    return rotation_angle(quaternions(orientations), true)


def test_six_sensors_go_on_without_the_faulty_one(session, tmp_path):
    begins, orientations, samples, levels = session(6, 'degraded: joint_3a excluded')
    assert all(message.name == [*ALL_JOINT_NAMES] for _, message in samples)
    after = stamps(orientations) * 1e-9 > begins + ALERT
    assert after.sum() > 0.2 * RATE
    level = max(message.data[0] for _, message in levels)
    assert all(len(message.data) == 1 + 6 + 6 for _, message in levels)
    assert levels[0][1].layout.dim[0].label.endswith('bound_joint_3c_deg')
    assert wrong(orientations).max() < level < 1.0
    assert read_joints(tmp_path / 'measured_js.csv', '').values.shape[1] == 6


def test_five_sensors_fall_silent(session):
    begins, orientations, samples, _ = session(5, 'silent: ')
    assert all(message.name == [*ALL_JOINT_NAMES[:5]] for _, message in samples)
    assert max(stamps(samples)) * 1e-9 > begins + 2.0 * ALERT
    assert max(stamps(orientations)) * 1e-9 < begins + ALERT
    assert wrong(orientations).max() < 1.0


def test_a_driver_of_six_and_an_fkm_of_four_are_silent(start, observer):
    states = observer.collect(String, 'state', STATE)
    orientations = observer.collect(QuaternionStamped, 'orientation')
    start('fkm')
    start('encoder_driver', parameters={**SIM, 'sensors': 6, 'rate': RATE})
    expected = 'silent: sample of another number of sensors'
    assert observer.spin_until(
        lambda: expected in [message.data for _, message in states], PATIENCE), states
    assert orientations == []
