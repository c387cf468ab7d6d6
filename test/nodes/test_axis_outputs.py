# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Insertion and gripper of the driver: topics, rates, entries on /diagnostics, recording."""

from harness import stamp
from in_process import hosted
import numpy as np
import pytest
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.encoders.single_axis import AxisReading, make_axes
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.nodes import encoder_driver
from spm_haptic_master.nodes.axis_outputs import AxisOutputs
from spm_haptic_master.nodes.recorder import Recorder
from spm_haptic_master.parameters.axes import AXIS_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros.diagnostic_status import ERROR, OK
from spm_haptic_master.ros.parameters import ParameterNode

MILLISECOND = 1_000_000


class WithAxes(ParameterNode):
    """A node with the outputs of both axes."""

    def __init__(self, parameters):
        super().__init__('encoder_driver', parameters)
        given = {'insertion.id': 0x185, 'gripper.id': 0x186}
        values = complete(AXIS_SETTINGS, given) | {'rate': 1000.0}
        self.axes = make_axes(values, 0.5)
        self.outputs = AxisOutputs(self, self.axes, 'sim', 200.0)


def test_each_reading_of_the_slide_goes_out_and_the_gripper_at_its_rate():
    with hosted(WithAxes) as host:
        readings = [
            AxisReading(name, host.time_ns() + number * MILLISECOND, 1e-3 * number)
            for number in range(100)
            for name in ('insertion', 'gripper')
        ]
        host.node.outputs.publish(readings)
        sent = host.sent['insertion/measured_js']
        assert [message.position[0] for message in sent] == [1e-3 * n for n in range(100)]
        assert all(list(message.name) == ['insertion'] for message in sent)
        assert set(np.diff([stamp(message) for message in sent])) == {MILLISECOND}
        grips = host.sent['gripper/measured_js']
        assert set(np.diff([stamp(message) for message in grips])) == {5 * MILLISECOND}


def test_an_axis_has_an_entry_that_says_why_it_is_silent():
    with hosted(WithAxes) as host:
        host.run(1.0)
        host.node.outputs.report(host.time())
        entry = host.entry('insertion')
        assert (entry.level, entry.message) == (ERROR, 'insertion missing (no frames)')
        host.node.axes[0].latest = host.time(), 0.1
        host.node.outputs.report(host.time())
        assert (host.entry('insertion').level, host.entry('insertion').message) == (
            OK,
            'publishing',
        )
        assert host.figures('insertion')['position'] == '0.1'


def driver(*settings):
    return hosted(
        lambda given: encoder_driver.EncoderDriver(given, Future()),
        'source:=sim',
        *settings,
    )


def test_the_driver_has_the_topics_of_the_axes_that_are_configured():
    for settings, expected in (
        ((), set()),
        (('insertion.id:=0x185',), {'insertion/measured_js'}),
        (
            ('insertion.id:=0x185', 'gripper.id:=0x186'),
            {'insertion/measured_js', 'gripper/measured_js'},
        ),
    ):
        with driver(*settings) as host:
            topics = {each.topic_name.lstrip('/') for each in host.node.publishers}
            assert {topic for topic in topics if '/measured_js' in topic} == expected


def test_a_gripper_of_fkm_beside_an_encoder_is_refused():
    with pytest.raises(SettingError, match="'gripper.axis'.*nothing where the gripper has an"):
        with driver('gripper.id:=0x186', 'gripper.axis:=1'):
            pass


def test_both_are_recorded(tmp_path):
    directory = tmp_path / 'session'
    with hosted(lambda given: Recorder(given, Future()), f'directory:={directory}') as host:
        for axis, position in (('insertion', 0.05), ('gripper', 0.5)):
            message = JointState(name=[axis], position=[position])
            message.header.stamp.sec = 5
            host.give(f'{axis}/measured_js', message)
            # Another joint on the topic is not written.
            host.give(f'{axis}/measured_js', JointState(name=['other'], position=[1.0]))
    for axis, position in (('insertion', 0.05), ('gripper', 0.5)):
        assert (directory / f'{axis}.csv').read_text().splitlines() == [
            f'time,{axis}',
            f'5.000000000,{position:.9f}',
        ]
