# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process that comes later is connected at once: how often the nodes announce themselves."""

from disturbance import Disturbance
import pytest
from spm_haptic_master.ros.discovery import profile, VARIABLES

# Subscribers that come one after the other.
SUBSCRIBERS = 6
# Longest time from the subscription to the first sample (s): an announcement's period, 0.25 s, and
# what a machine at work needs. By default of Fast DDS it is up to 3 s.
CONNECTED = 1.5
# Prints the time from the subscription to the first sample, s.
SUBSCRIBER = """
import time
import rclpy
from rclpy.experimental.events_executor import EventsExecutor
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node('subscriber')
executor = EventsExecutor()
executor.add_node(node)
arrived = []
node.create_subscription(JointState, 'measured_js', lambda _: arrived.append(time.monotonic()), 10)
began = time.monotonic()
while not arrived:
    executor.spin_once(timeout_sec=0.02)
print(arrived[0] - began)
node.destroy_node()
executor.shutdown()
rclpy.shutdown()
"""


@pytest.mark.process
@pytest.mark.alone
def test_a_subscriber_that_comes_later_is_connected_at_once(start, start_python):
    # The driver selects the profile by itself; the subscribers are any program's.
    unset = dict.fromkeys(VARIABLES, '')
    start('encoder_driver', parameters={'source': 'sim', 'rate': 200.0}, **unset)
    times = []
    with Disturbance() as machine:
        for number in range(SUBSCRIBERS + 1):
            subscriber = start_python('-c', SUBSCRIBER)
            assert subscriber.wait(60.0) == 0, subscriber.stderr
            if number:  # the first one waits for the driver to start
                # Fast DDS may print before it, of a port that a killed process has left.
                times.append(float(subscriber.stdout.splitlines()[-1]))
    machine.expect(max(times) < CONNECTED, times)


def test_the_packages_profile_is_selected_where_the_user_has_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    selected = profile({})
    assert set(selected) == set(VARIABLES)
    assert all(value.endswith('/config/fastdds.xml') for value in selected.values())
    assert [profile({name: 'mine.xml'}) for name in VARIABLES] == [{}, {}]
    (tmp_path / 'DEFAULT_FASTRTPS_PROFILES.xml').touch()
    assert profile({}) == {}
