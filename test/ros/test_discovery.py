# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process that comes later is connected at once: how often the nodes announce themselves."""

from contextlib import closing
import time

from disturbance import Disturbance
from harness import Observer
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.ros.discovery import profile, VARIABLES

# Subscribers that come one after the other.
SUBSCRIBERS = 6
# Longest time from the subscription to the first sample (s): an announcement's period, 0.25 s, and
# what a machine at work needs. By default of Fast DDS it is up to 3 s.
CONNECTED = 1.5


@pytest.mark.process
@pytest.mark.alone
def test_a_subscriber_that_comes_later_is_connected_at_once(start):
    # The driver selects the profile by itself.
    start('encoder_driver', parameters={'source': 'sim', 'rate': 200.0},
          **dict.fromkeys(VARIABLES, ''))
    times = []
    with Disturbance() as machine:
        for _ in range(SUBSCRIBERS + 1):
            with closing(Observer()) as observer:
                began = time.monotonic()
                arrived = observer.collect(JointState, 'measured_js')
                assert observer.spin_until(lambda arrived=arrived: arrived, 60.0)
                times.append(time.monotonic() - began)
        # The first one waits for the driver to start.
    machine.expect(max(times[1:]) < CONNECTED, times)


def test_the_packages_profile_is_selected_where_the_user_has_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    selected = profile({})
    assert set(selected) == set(VARIABLES)
    assert all(value.endswith('/config/fastdds.xml') for value in selected.values())
    assert [profile({name: 'mine.xml'}) for name in VARIABLES] == [{}, {}]
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()
    assert profile({}) == {}
