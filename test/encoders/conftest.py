# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A virtual bus of the test's own with simulated encoders, and a source on a scripted bus."""

from contextlib import ExitStack
import threading
from unittest.mock import Mock
import uuid

import can
from encoder_frames import LAYOUTS, values
import pytest
from scripted_bus import Clock, ScriptedBus
from spm_haptic_master import timing
from spm_haptic_master.encoders import bus_scan, can_bus, can_source, replay_source, sync
from spm_haptic_master.encoders.sync import SyncProducer
from spm_haptic_master.simulation.bus_runner import BusRunner
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.timing import DeadlineGrid


@pytest.fixture
def channel():
    """Give a virtual channel of the test's own."""
    return f'channel_{uuid.uuid4().hex}'


@pytest.fixture
def encoders(channel):
    """Run sim_bus's encoders, still or with SYNC, until the test's end; give their nodes."""
    end = threading.Event()

    def make(factory=False, sync=False, layouts=LAYOUTS, node_ids=(1, 2, 3, 4)):
        made = SimulatedBus(layouts, node_ids, make_motion(values('sim', sim__noise_deg=0.0)),
                            (), 0.1, 1, factory=factory)
        bus = stack.enter_context(can.Bus(interface='virtual', channel=channel))
        runner = BusRunner(bus, made, 0x80, DeadlineGrid(0.01) if sync else None)

        def loop():
            runner.boot()
            while not end.is_set():
                runner.step()

        thread = threading.Thread(target=loop)
        thread.start()
        stack.callback(thread.join)
        return made.nodes

    with ExitStack() as stack:
        yield make
        end.set()


@pytest.fixture
def clock(monkeypatch):
    """Put the modules that wait on a clock that only the test moves."""
    clock = Clock()
    for module in (bus_scan, can_source, replay_source, sync, timing):
        monkeypatch.setattr(module, 'time', clock)
    return clock


@pytest.fixture
def rig(monkeypatch, clock):
    """Make a source on scripted buses, one for each time that it opens one."""
    def make(*buses, **overrides):
        """`buses` are scripts, or exceptions that opening raises; the last one stays."""
        scripted = [bus if isinstance(bus, Exception) else ScriptedBus(clock, bus)
                    for bus in buses]
        opened = []

        def opening(interface, channel, bitrate, own=False):
            bus = scripted[min(len(opened), len(scripted) - 1)]
            opened.append((clock.now, interface, channel, bitrate, own))
            if isinstance(bus, Exception):
                raise bus
            return bus

        monkeypatch.setattr(can_bus, 'open_bus', opening)
        source = make_source('can', values(
            can__interface='virtual', can__channel='can7', **overrides))
        source.opened, source.buses, source.clock = opened, scripted, clock
        return source

    return make


@pytest.fixture
def producing(rig, monkeypatch):
    """Make a source on a scripted bus, and the producer of SYNC that stands in for its own."""
    def make(*buses, **overrides):
        producer = Mock(spec=SyncProducer, yielding=False, producing=False, lost=0.0)
        producer.openings.return_value, producer.statistics.return_value = [], {}
        made = Mock(return_value=producer)
        monkeypatch.setattr(can_source, 'SyncProducer', made)
        driver = rig(*buses, can__sync='produce', **overrides)
        producer.made_with = made.call_args.args[1:]
        return driver, producer

    return make
