# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two masters in one domain."""

from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import SIM
import pytest
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
            lambda: (
                '/orientation is published by /fkm already: end that one, or start this one '
                'with another ROS_DOMAIN_ID' in second.stderr
            ),
            PATIENCE,
        )
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
