# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page of all devices: which are on it, and what is there without any."""

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.nodes.qos import STATE
from std_msgs.msg import String

pytest.importorskip('viser', reason='viser is not installed (extra view)')
view_node = pytest.importorskip('spm_haptic_master.view.node')

PATIENCE = 20.0


@pytest.fixture
def view(observer):
    """Give the node `view`; it runs while the observer does."""
    rclpy.init(args=['--ros-args', '-p', 'view.port:=28480'])
    node = view_node.View(Future())
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.spin = lambda condition: observer.spin_until(
        lambda: executor.spin_once(0.01) or condition(), PATIENCE)
    yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


def test_a_calibration_is_on_the_page_while_its_program_runs(view, observer):
    out = observer.node.create_publisher(String, f'/left/{COVERAGE_TOPIC}', STATE)
    out.publish(String(data='{"text": "turn it", "covered": {"precision": 0.4}}'))

    def shown():
        return '/left' in view._arms and view._arms['/left'].panel.calibrates

    assert view.spin(shown)
    observer.node.destroy_publisher(out)
    assert view.spin(lambda: not shown())
