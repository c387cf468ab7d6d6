# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a calibration by motion shows of itself as a topic."""

import json

import pytest
from spm_haptic_master.nodes.guidance_publisher import published
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String


@pytest.mark.process
def test_it_is_there_while_a_motion_is_recorded(observer):
    found = observer.collect(String, '/left/calibration/coverage', STATE)
    with published(['__ns:=/left']) as publish:
        publish('tilt the handle', {'precision': 0.25})
        assert observer.spin_until(lambda: found, 60.0)
        assert json.loads(found[-1][1].data) == {
            'text': 'tilt the handle',
            'covered': {'precision': 0.25},
        }
    assert observer.spin_until(lambda: found[-1][1].data == '{}', 60.0)
