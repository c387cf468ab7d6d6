# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A source on a scripted bus."""

from unittest.mock import Mock

from encoder_frames import values
import pytest
from scripted_bus import Clock, ScriptedBus
from spm_haptic_master import timing
from spm_haptic_master.encoders import bus_scan, can_bus, can_source, replay_source, sync
from spm_haptic_master.encoders.sync import SyncProducer
from spm_haptic_master.simulation.source_factory import make_source


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
        scripted = [
            bus if isinstance(bus, Exception) else ScriptedBus(clock, bus) for bus in buses
        ]
        opened = []

        def opening(interface, channel, bitrate, own=False):
            bus = scripted[min(len(opened), len(scripted) - 1)]
            opened.append((clock.now, interface, channel, bitrate, own))
            if isinstance(bus, Exception):
                raise bus
            return bus

        monkeypatch.setattr(can_bus, 'open_bus', opening)
        source = make_source(
            'can',
            values(
                can__interface='virtual',
                can__channel='can7',
                **overrides,
            ),
        )
        source.opened = opened
        source.buses = scripted
        source.clock = clock
        return source

    return make


@pytest.fixture
def producing(rig, monkeypatch):
    """Make a source on a scripted bus, and the producer of SYNC that stands in for its own."""

    def make(*buses, **overrides):
        producer = Mock(
            spec=SyncProducer,
            yielding=False,
            producing=False,
            lost=0.0,
        )
        producer.openings.return_value = []
        producer.statistics.return_value = {}
        made = Mock(return_value=producer)
        monkeypatch.setattr(can_source, 'SyncProducer', made)
        driver = rig(*buses, can__sync='produce', **overrides)
        producer.made_with = made.call_args.kwargs
        return driver, producer

    return make
