# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a CRTK client gets of the master: poses at a rate of their own, and the interlock."""

import os
import signal

import crtk_package
from geometry_msgs.msg import PoseStamped, QuaternionStamped, TwistStamped
from harness import SIM, stamp, start_program
import numpy as np
import pytest
from sensor_msgs.msg import JointState, Joy
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String, UInt64
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process

# A pause of a busy machine is no silence.
PATIENT = {'sample_timeout': 2.0, 'max_age': 2.0}
TOPICS = {'measured_cp': PoseStamped, 'setpoint_cp': PoseStamped, 'measured_cv': TwistStamped,
          'crtk/measured_js': JointState, 'gripper/measured_js': JointState}


def call(observer, name):
    client = observer.node.create_client(Trigger, name)
    assert client.wait_for_service(20.0)
    future = client.call_async(Trigger.Request())
    assert observer.spin_until(future.done, 20.0)
    return future.result().success, future.result().message


def test_poses_have_a_rate_of_their_own_and_equal_stamps(observer):
    arrived = {topic: observer.collect(kind, topic) for topic, kind in TOPICS.items()}
    orientations = observer.collect(QuaternionStamped, 'orientation')
    joints = observer.collect(JointState, 'measured_js')
    axis = observer.node.create_publisher(Joy, 'gripper/joy', 10)
    # At 500 Hz, every tenth.
    master = start_program('master', parameters={
        **SIM, **PATIENT, 'rate': 500, 'crtk_rate': 50, 'gripper.axis': 1,
        'measured_js.frame_id': 'spm_base'})
    try:
        assert observer.spin_until(lambda: len(arrived['measured_cv']) > 20, 40.0)
        # Nothing of a gripper before its axis has a value.
        assert arrived['gripper/measured_js'] == []
        assert observer.spin_until(
            lambda: axis.publish(Joy(axes=[0.0, 0.5])) or arrived['gripper/measured_js'], 20.0)
        for messages in arrived.values():
            messages.clear()
        orientations.clear()
        observer.spin(2.0)
        stamps = {topic: [stamp(message) for _, message in messages]
                  for topic, messages in arrived.items()}
        common = set(stamps['measured_cp'])
        for topic, found in stamps.items():
            # What was under way at the ends; and there is no velocity across a pause.
            assert len(set(found) - common) <= 4
            assert len(common - set(found)) <= (4 if topic != 'measured_cv' else len(common) / 4)
        assert np.median(np.diff(stamps['measured_cp'])) == pytest.approx(20e6, rel=0.02)
        # Each sample has its orientation; a busy machine makes fewer of them.
        assert len(orientations) > 4 * len(common)
        of = {stamp(message): message for _, message in orientations}
        poses = {stamp(message): message.pose for _, message in arrived['measured_cp']}
        for each in common & set(of):
            assert poses[each].orientation == of[each].quaternion
        for messages in (*arrived.values(), joints):
            assert {message.header.frame_id for _, message in messages} == {'spm_base'}
        positions = {stamp(message): message.position for _, message in joints}
        copies = [message for _, message in arrived['crtk/measured_js']]
        assert all(message.name == list(JOINT_NAMES) for message in copies)
        shared = [message for message in copies if stamp(message) in positions]
        assert len(shared) > 20
        assert all(message.position == positions[stamp(message)] for message in shared)
        gripper = arrived['gripper/measured_js'][-1][1]
        assert list(gripper.position) == pytest.approx([np.radians(45.0)])
    finally:
        assert master.stop() == 0, master.stderr


def test_silence_is_a_fault_until_enable_without_crtk_msgs(observer, tmp_path):
    """With them: test_crtk_client."""
    path = filter(None, [str(crtk_package.hide(tmp_path)), os.environ.get('PYTHONPATH')])
    texts = observer.collect(String, 'operating_state_text', STATE)
    enabled = observer.collect(UInt64, 'enabled_at', STATE)
    errors = observer.collect(String, 'error')
    states = observer.collect(String, 'state', STATE)
    driver = start_program('encoder_driver', parameters={**SIM, 'rate': 100})
    fkm = start_program('fkm', parameters={
        **PATIENT, 'rate': 100, 'sample_timeout': 0.5, 'recovery': 0.2},
                        PYTHONPATH=os.pathsep.join(path))
    try:
        assert observer.spin_until(
            lambda: states and states[-1][1].data == 'healthy', 40.0)
        assert call(observer, 'enable') == (True, 'ENABLED')
        types = dict(observer.node.get_topic_names_and_types())
        assert '/operating_state' not in types
        assert observer.spin_until(lambda: enabled[-1][1].data > 0, 5.0)
        first = enabled[-1][1].data
        driver.send_signal(signal.SIGSTOP)
        assert observer.spin_until(
            lambda: texts[-1][1].data == 'FAULT' and enabled[-1][1].data == 0 and errors, 5.0)
        assert errors[-1][1].data == 'silent: no joint samples'
        success, message = call(observer, 'enable')
        assert not success and 'silent: no joint samples' in message
        driver.send_signal(signal.SIGCONT)
        assert observer.spin_until(lambda: texts[-1][1].data == 'DISABLED', 20.0)
        observer.spin(1.0)
        assert [message.data for _, message in texts][-1] == 'DISABLED'
        assert enabled[-1][1].data == 0
        assert call(observer, 'enable') == (True, 'ENABLED')
        assert observer.spin_until(lambda: enabled[-1][1].data > first, 5.0)
        assert call(observer, 'disable') == (True, 'DISABLED')
        # A controller is told of an orderly end.
        assert call(observer, 'enable') == (True, 'ENABLED')
        assert fkm.stop() == 0
        assert observer.spin_until(
            lambda: texts[-1][1].data == 'FAULT' and enabled[-1][1].data == 0 and errors, 5.0)
    finally:
        driver.send_signal(signal.SIGCONT)
        assert fkm.stop() == 0 and driver.stop() == 0
    assert fkm.stderr.count('crtk_msgs is not installed') == 1
