# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topic `readings`: a few of the driver's sets a second, for who looks at the device."""

from harness import SIM
import pytest
from sensor_msgs.msg import JointState

pytestmark = pytest.mark.process
PATIENCE = 60.0


def test_readings_are_some_of_the_sets_at_the_pace_of_the_eye(start, observer):
    sets = observer.collect(JointState, 'measured_js')
    readings = observer.collect(JointState, 'readings')
    start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    assert observer.spin_until(lambda: len(readings) >= 12, PATIENCE)

    def by_stamp(messages):
        return {(m.header.stamp.sec, m.header.stamp.nanosec): list(m.position)
                for _, m in messages}

    known, found = by_stamp(sets), by_stamp(readings)
    first = min(known)
    common = [stamp for stamp in found if first <= stamp <= max(known)]
    assert len(common) >= 10
    assert all(found[stamp] == known[stamp] for stamp in common)
    times = sorted(sec + 1e-9 * nanosec for sec, nanosec in found)
    assert all(later - before >= 0.0499 for before, later in zip(times, times[1:], strict=False))
