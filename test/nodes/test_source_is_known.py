# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nobody takes a simulated or replayed angle for a measured one."""

from diagnostic_msgs.msg import DiagnosticArray
from harness import SIM, stamp, status
import numpy as np
import pytest
from recording import LOG
from sensor_msgs.msg import JointState
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
ENTRY = 'encoder_driver: encoders'
REPLAY = {'source': 'replay', 'replay.path': LOG, 'replay.loop': True, **simulated_rig()}
CAN = {'source': 'can', 'can.interface': 'udp_multicast', **simulated_rig()}


@pytest.mark.parametrize(('parameters', 'text'), [
    (SIM, 'sim'), (REPLAY, f'replay: {LOG.name}'), (CAN, 'can: udp_multicast CHANNEL')])
def test_the_source_is_on_a_latched_topic_and_on_diagnostics(
        start, observer, bus_channel, parameters, text):
    """And only a simulated one has topics that move it."""
    if parameters is CAN:
        parameters, text = {**CAN, 'can.channel': bus_channel}, text.replace(
            'CHANNEL', bus_channel)
    health = observer.collect(DiagnosticArray, '/diagnostics')
    sets, readings = (observer.collect(JointState, topic) for topic in ('measured_js', 'readings'))
    start('encoder_driver', parameters={'rate': 200.0, **parameters})
    assert observer.spin_until(lambda: status(health, ENTRY), PATIENCE)
    late = observer.collect(String, 'source', STATE)
    assert observer.spin_until(lambda: late, PATIENCE)
    assert [message.data for _, message in late] == [text]
    entry = status(health, ENTRY)
    assert entry.message.endswith(f' [{text}]')
    assert entry.hardware_id == text
    assert {value.key: value.value for value in entry.values}['source'] == text
    topics = {topic for topic, _ in observer.node.get_topic_names_and_types()
              if 'simulation' in topic or 'ground_truth' in topic}
    assert len(topics) == (5 if parameters is SIM else 0)
    if parameters is SIM:
        # `readings` are some of the sets, at the pace of the eye.
        assert observer.spin_until(lambda: len(readings) >= 12, PATIENCE)
        known, found = ({stamp(message): message.position for _, message in messages}
                        for messages in (sets, readings))
        common = [when for when in found if min(known) <= when <= max(known)]
        assert len(common) >= 10
        assert all(found[when] == known[when] for when in common)
        assert np.diff(sorted(found)).min() >= 49_900_000
