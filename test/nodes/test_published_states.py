# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The states that fkm publishes are those that `supervise` reports for the same samples."""

from pathlib import Path
import sys
import time

import numpy as np
import pytest
import rclpy
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros.diagnostic_status import CHECK_PERIOD
from spm_haptic_master.ros.overload import Overload
from spm_haptic_master.supervision import supervise

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'supervision'))

from device import encoders, joint_angles, motion  # noqa: E402, I100

# Samples of a run, their period (ns), the first of a fault, and the last of one that ends.
COUNT, PERIOD, BEGIN, END = 1500, 2_000_000, 400, 700
# Samples between two polls of the node: 20 ms, and not always the same number.
BETWEEN = (9, 10, 11)
# A pause of the machine is no silence, and stamps may be of another time than now (s).
PATIENT = {'sample_timeout': 10.0, 'max_age': 10.0}
PARAMETERS = {'recovery': 0.3, 'rate': 500.0}


def healthy(angles, times):
    pass


def spikes(angles, times):
    angles[BEGIN:END:12, 1] += np.radians(5.0)


def fault(angles, times):
    angles[BEGIN:END, 1] += np.radians(5.0)


def fault_that_stays(angles, times):
    angles[BEGIN:, 0] += np.radians(5.0)


def two_that_cancel(angles, times):
    angles[BEGIN:, :2] += np.radians(2.0) * np.array([1.0, -0.935])


def noise(angles, times):
    angles[BEGIN:, 2] += np.radians(2.0) * np.random.default_rng(5).normal(size=COUNT - BEGIN)


def missing_and_return(angles, times):
    angles[BEGIN:END, -1] = np.nan


def missing_at_the_start(angles, times):
    angles[:END, 0] = np.nan


def wrong_at_the_start(angles, times):
    angles[1:20, 3] += np.radians(20.0)


def lost_samples(angles, times):
    angles[BEGIN:BEGIN + 50] = np.nan


def gap(angles, times):
    times[BEGIN:] += 600_000_000


def clock_set_back(angles, times):
    times[BEGIN:] -= 2_000_000_000


EVENTS = (healthy, spikes, fault, fault_that_stays, two_that_cancel, noise, missing_and_return,
          missing_at_the_start, wrong_at_the_start, lost_samples, gap, clock_set_back)


@pytest.fixture(scope='module')
def ros():
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.fixture
def published(ros, monkeypatch):
    """Run samples through a node of this process; return the words that it publishes."""
    monkeypatch.setattr(Overload, 'explains', lambda *_: False)
    nodes = []

    def published(times, angles):
        settings = {'sensors': angles.shape[1], **PATIENT, **PARAMETERS}
        node = Fkm(Parameters((), [f'{name}:={value}' for name, value in settings.items()],
                              ['__ns:=/of_the_test']))
        nodes.append(node)
        (poll,) = (timer.callback for timer in node.timers
                   if timer.timer_period_ns == round(CHECK_PERIOD * 1e9))
        (out,) = (each for each in node.publishers if each.topic_name.endswith('/state'))
        words = []
        monkeypatch.setattr(out, 'publish', lambda message: words.append(message.data))
        times = times + time.time_ns()
        until = np.cumsum(np.resize(BETWEEN, COUNT))
        for index, (stamp, row) in enumerate(zip(times.tolist(), angles.tolist(), strict=True)):
            node.take(stamp, tuple(row))
            if index in until:
                poll()
        poll()
        return words

    yield published
    for node in nodes:
        node.destroy_node()


@pytest.mark.parametrize('sensors', [4, 6])
@pytest.mark.parametrize('event', EVENTS)
def test_fkm_publishes_the_states_of_supervise(published, event, sensors):
    times = np.arange(COUNT, dtype=np.int64) * PERIOD
    angles = encoders(joint_angles(motion('turning', COUNT * PERIOD * 1e-9, 1e9 / PERIOD),
                                   sensors))
    event(angles, times)
    expected = [text for _, text in supervise(
        times + 10_000_000_000, angles, sensors=sensors, **PARAMETERS).state]
    assert expected[0] == 'starting'
    assert (expected == ['starting', 'healthy']) is (event is healthy)
    assert published(times, angles) == expected
