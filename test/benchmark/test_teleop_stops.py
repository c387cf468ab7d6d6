# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command stops when a process of the chain does, and its return moves nothing."""

import signal

from benchmarks import teleop_stops
from benchmarks.teleop_stops import measure_stops, stops_table, TIMEOUTS
from disturbance import Disturbance
import pytest

# Time-outs that a pause of a busy machine does not reach (s).
TIMEOUT = 0.5
PARAMETERS = {
    'rate': '200',
    'sample_timeout': f'{TIMEOUT}',
    'max_age': '1.0',
    **{name: f'{TIMEOUT}' for name in TIMEOUTS.values() if name},
}
# What the middleware and the observer of a busy machine may add to a stop (ms).
SLACK = 100.0
# Time after the return in which there must be no command (s): 100 periods of it.
RETURN = 0.5
# Stops: one that is killed is missed by the others only after seconds.
WHICH = [*((process, signal.SIGSTOP) for process in TIMEOUTS), ('teleop', signal.SIGKILL)]


@pytest.mark.process
@pytest.mark.alone
def test_every_process_that_stops_stops_the_slave(monkeypatch):
    monkeypatch.setattr(teleop_stops, 'RETURN', RETURN)
    timeouts = {name: TIMEOUT if name else 0.0 for name in TIMEOUTS.values()}
    with Disturbance() as machine:
        found = measure_stops(1, PARAMETERS, timeouts, 0.005, WHICH)
    print(stops_table(found))
    assert {(stops.process, stops.number) for stops in found} == set(WHICH)
    for stops in found:
        machine.expect(max(stops.times) <= stops.limit + SLACK, stops)
        machine.expect(stops.commands == 0, stops)
        machine.expect(stops.off < 0.5, stops)
