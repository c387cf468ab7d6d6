# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two masters in one domain, and a filter between the nodes of one."""

from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import SIM, stamp
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0


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
