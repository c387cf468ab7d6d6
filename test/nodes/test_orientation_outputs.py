# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What fkm publishes beside the orientation, while another thread notices subscribers."""

from math import cos, sin
from types import SimpleNamespace

import pytest
from spm_haptic_master.nodes.orientation_outputs import OrientationOutputs
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete

MILLISECOND = 1_000_000


class Publisher:
    """A publisher with a number of subscribers, and what it published."""

    def __init__(self):
        self.subscribers, self.sent = 0, []

    def get_subscription_count(self):
        return self.subscribers

    def publish(self, message):
        self.sent.append(message)


class Estimate:
    """An orientation that turns at 1 rad/s, and what happens while it is published."""

    covariance = (0.0,) * 9

    def __init__(self, seconds, meanwhile=lambda: None):
        self._half, self._meanwhile = 0.5 * seconds, meanwhile

    @property
    def quaternion(self):
        self._meanwhile()
        return 0.0, 0.0, sin(self._half), cos(self._half)


def test_a_subscriber_that_comes_within_a_sample_gets_no_velocity_of_long_ago():
    outs = {}
    node = SimpleNamespace(create_publisher=lambda _, topic, *args, **options:
                           outs.setdefault(topic, Publisher()))
    outputs = OrientationOutputs(
        node, complete(FKM_SETTINGS, {'crtk_rate': 0.0}), 'spm_base', None)

    def subscribe(twists):
        outs['measured_cp'].subscribers, outs['measured_cv'].subscribers = 1, twists
        outputs.count_subscribers()

    def publish(milliseconds, meanwhile=lambda: None):
        outputs.publish(milliseconds * MILLISECOND, (0.0,) * 4,
                        Estimate(1e-3 * milliseconds, meanwhile), 0.0)

    subscribe(1)
    for milliseconds in range(50):
        publish(milliseconds)
    twists = len(outs['measured_cv'].sent)
    assert twists and outs['measured_cv'].sent[-1].twist.angular.z == pytest.approx(1.0, abs=1e-3)
    subscribe(0)
    publish(9_000)
    publish(9_001, meanwhile=lambda: subscribe(1))
    assert len(outs['measured_cv'].sent) == twists
    assert len(outs['measured_cp'].sent) == 52
