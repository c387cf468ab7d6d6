# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command stops when a process of the chain does, and its return moves nothing."""

import signal

from benchmarks.teleop_stops import measure_stops, Stops, stops_table, TIMEOUTS
from disturbance import Disturbance
import pytest
from spm_haptic_master.benchmark.pipeline import PipelineError
from spm_haptic_master.benchmark.surgeon import Arrived
from spm_haptic_master.benchmark.teleop_demo import summary, table
from spm_haptic_master.kinematics.rotations import quaternion_from_vector

MS = 1_000_000
# Time-outs that a pause of a busy machine does not reach (s).
TIMEOUT = 0.5
PARAMETERS = {'rate': '200', 'sample_timeout': f'{TIMEOUT}', 'max_age': '1.0',
              **{name: f'{TIMEOUT}' for name in TIMEOUTS.values() if name}}
# What the middleware and the observer of a busy machine may add to a stop (ms).
SLACK = 100.0


# Stops: one that is killed is missed by the others only after seconds.
WHICH = [(process, signal.SIGSTOP) for process in TIMEOUTS] + [
    ('teleop', signal.SIGKILL)]


@pytest.mark.process
@pytest.mark.alone
def test_every_process_that_stops_stops_the_slave():
    timeouts = {name: TIMEOUT if name else 0.0 for name in TIMEOUTS.values()}
    with Disturbance() as machine:
        try:
            found, error = measure_stops(1, PARAMETERS, timeouts, 0.005, WHICH), None
        except PipelineError as caught:
            found, error = [], caught
    machine.expect(error is None, error)
    print(stops_table(found))
    assert {(stops.process, stops.number) for stops in found} == set(WHICH)
    for stops in found:
        machine.expect(max(stops.times) <= stops.limit + SLACK, stops)
        machine.expect(stops.commands == 0, stops)
        machine.expect(stops.off < 0.5, stops)


def test_the_table_of_stops():
    stops = Stops('fkm', signal.SIGKILL, 60.0, [1.0, 2.0, 6.0], 0, 0.25)
    assert '| fkm | SIGKILL | 2.0 | 5.9 | 6.0 | 60 | 0 | 0.250 |' in stops_table([stops])


def arrived(ms, angle):
    return Arrived(ms * MS, ms * MS, quaternion_from_vector(0.0, 0.0, angle))


def test_the_summary_of_a_demonstration():
    # Two stretches: 0.01 rad in 5 ms, then a fresh start from the slave's pose, 0.002 rad off.
    commands = [arrived(1000, 0.0), arrived(1005, 0.01), arrived(1010, 0.012),
                arrived(2000, 0.112), arrived(2005, 0.113)]
    poses = [arrived(999, 0.0), arrived(1007, 0.0), arrived(1500, 0.11), arrived(2006, 0.112)]
    found = summary(commands, poses, [], lost=1008 * MS, enabled=1900 * MS)
    assert (found.commands, found.starts, found.while_lost) == (5, 2, 0)
    assert found.largest_start == pytest.approx(0.1146, abs=1e-4)
    assert found.largest_step == pytest.approx(0.5730, abs=1e-4)
    assert found.largest_speed == pytest.approx(2.0, abs=1e-6)
    assert found.stop == pytest.approx(2.0)
    assert '| angular speed of the command, largest | 2.00 rad/s |' in table(found)
