# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A live bus: SYNC made and followed, nodes started, losses told and mended."""

import threading
import time

import can
from encoder_frames import LAYOUTS, values
import pytest

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_source import REASON_HOLD
from spm_haptic_master.encoders.receive_clock import ReceiveClock
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.source_factory import make_source


@pytest.fixture
def channel(request):
    """Give a virtual channel of the test's own."""
    return f'channel of {request.node.name}'


@pytest.fixture
def source(channel):
    """Make a source on the channel; closed at the test's end."""
    made = []

    def make(**overrides):
        made.append(make_source('can', values(
            can__interface='virtual', can__channel=channel, **overrides)))
        return made[-1]

    yield make
    for each in made:
        each.close()


class Encoders:
    """Four simulated encoders on the channel, in a thread of their own."""

    def __init__(self, channel, *faults):
        self.bus = can.Bus(interface='virtual', channel=channel, receive_own_messages=False)
        motion = make_motion(values('sim', sim__noise_deg=0.0))
        self.encoders = SimulatedBus(LAYOUTS, (1, 2, 3, 4), motion,
                                     tuple(map(parse_fault, faults)), 0.05, 1)
        self.heard = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        for message in self.encoders.boot():
            self.bus.send(message)
        while not self._stop.is_set():
            message = self.bus.recv(0.005)
            answers = []
            if message is not None:
                self.heard.append(message)
                answers = self.encoders.cycle(time.monotonic()) \
                    if message.arbitration_id == 0x80 else self.encoders.receive(message)
            for each in answers + self.encoders.tend(time.monotonic()):
                self.bus.send(each)

    def close(self):
        self._stop.set()
        self._thread.join()
        self.bus.shutdown()


@pytest.fixture
def encoders(channel):
    """Make encoders on the channel; they leave it at the test's end."""
    made = []

    def make(*faults):
        made.append(Encoders(channel, *faults))
        return made[-1]

    yield make
    for each in made:
        each.close()


def read(source, seconds):
    """Return the sets that come within some seconds, with the time of each."""
    end, got = time.monotonic() + seconds, []
    while time.monotonic() < end:
        sample = source.read(0.02)
        if sample is not None:
            got.append((time.time_ns(), sample))
    return got


def test_sync_made_here_brings_coherent_sets(source, encoders):
    rig = encoders()
    driver = source(can__sync='produce', rate=200.0)
    got = read(driver, 1.5)
    assert driver.fault is None
    # 0.1 s of listening first; the machine may be busy.
    assert len(got) > 200
    told = driver.statistics()
    assert told['SYNC sent'] >= len(got)
    assert told["another master's SYNC"] == 0
    # Each stamp is on SYNC's grid, and before the set was read.
    assert all(now > sample.stamp for now, sample in got)
    syncs = [m for m in rig.heard if m.arbitration_id == 0x80]
    assert len(syncs) == pytest.approx(told['SYNC sent'], abs=20)
    # An absolute grid: however late single ones are, lateness does not add up.
    phases = [(sample.stamp - got[0][1].stamp) * 1e-9 * 200.0 for _, sample in got]
    together = max(sum((phase - place) % 1.0 < 0.3 for phase in phases) for place in phases)
    assert together > 0.8 * len(got)


def test_nodes_are_started_and_stopped_where_configured(source, encoders):
    rig = encoders()
    driver = source(can__sync='produce', rate=100.0, can__nmt_stop=True)
    read(driver, 0.4)
    driver.close()
    time.sleep(0.05)
    commands = [(m.data[0], m.data[1]) for m in rig.heard if m.arbitration_id == 0]
    assert {(canopen.NMT_START, n) for n in (1, 2, 3, 4)} <= set(commands)
    assert commands[-4:] == [(canopen.NMT_STOP, n) for n in (1, 2, 3, 4)]


@pytest.mark.parametrize('protocol', ['raw', 'canopen'])
def test_what_is_sent_while_another_master_makes_sync(source, channel, protocol):
    with can.Bus(interface='virtual', channel=channel) as bus:
        driver = source(can__protocol=protocol)
        read(driver, 0.1)
        sent = []
        while (message := bus.recv(0.0)) is not None:
            sent.append(message)
    expected = {canopen.NMT_ID} if protocol == 'canopen' else set()
    assert {m.arbitration_id for m in sent} == expected


def test_a_second_sync_master_is_followed_and_named(source, channel, encoders):
    encoders()
    driver = source(can__sync='produce', rate=100.0)
    read(driver, 0.5)
    assert driver.caution is None
    stop = threading.Event()

    def master():
        with can.Bus(interface='virtual', channel=channel) as bus:
            while not stop.wait(0.01):
                bus.send(canopen.frame(0x80))

    thread = threading.Thread(target=master, daemon=True)
    thread.start()
    read(driver, 0.3)
    before = driver.statistics()['SYNC sent']
    got = read(driver, 0.5)
    assert 'another master makes SYNC' in driver.caution
    assert driver.statistics()['SYNC sent'] == before
    assert len(got) > 20
    stop.set()
    thread.join()
    # It takes SYNC up again when the other has gone.
    got = read(driver, 1.8)
    assert driver.caution is None
    assert driver.statistics()['SYNC sent'] > before + 10


def test_a_rebooting_node_is_started_again(source, encoders):
    rig = encoders('reboot:joint_1c@0.5+0.3')
    driver = source(can__sync='produce', rate=100.0)
    got = read(driver, 0.4)
    assert len(got) > 10
    read(driver, 0.25)
    assert driver.fault == 'joint_1c silent (no frames)'
    assert read(driver, 0.6)
    assert driver.fault is None
    starts = [m for m in rig.heard if m.arbitration_id == 0 and m.data[1] == 3]
    assert len(starts) >= 2


@pytest.mark.parametrize(('stops', 'sets'), [(False, True), (True, False)])
def test_an_emergency_is_told_and_stops_where_configured(source, encoders, stops, sets):
    encoders('emcy:joint_3a@0.3+0.6=0x5000')
    driver = source(can__sync='produce', rate=100.0, can__emcy_stops=stops)
    read(driver, 0.6)
    got = read(driver, 0.2)
    assert bool(got) == sets
    words = 'joint_3a: EMCY 0x5000 device hardware, error register 0x01'
    assert (driver.fault if stops else driver.caution) == words
    assert words.split(': ')[1] in driver.statistics()['joint_3a EMCY']
    assert read(driver, 0.8)
    assert driver.fault is None
    assert driver.caution is None


def test_a_lost_heartbeat_is_told_while_sets_go_on(source, channel, encoders):
    rig = encoders()
    driver = source(can__sync='produce', rate=100.0, can__heartbeat_timeout=0.2)
    read(driver, 0.5)
    assert driver.caution is None
    rig.encoders.tend = lambda now: []
    assert read(driver, 0.4)
    assert driver.caution.startswith('joint_1a: heartbeat lost')
    assert driver.fault is None


def test_a_bus_that_is_not_there_is_opened_later():
    """A socketcan interface that is missing: tried again and again, never a hot loop."""
    driver = make_source('can', values(can__interface='socketcan', can__channel='can_nowhere'))
    began = time.monotonic()
    assert driver.read(0.5) is None
    assert time.monotonic() - began == pytest.approx(0.5, abs=0.2)
    assert driver.fault.startswith('socketcan can_nowhere: ')
    assert driver.statistics()['bus opened'] == 0
    driver.close()
    driver.close()


def test_bus_errors_have_words(source, channel, encoders):
    encoders('busoff@0.3+0.4')
    driver = source(can__sync='produce', rate=100.0)
    read(driver, 0.55)
    assert driver.fault == f'virtual {channel}: bus-off'
    assert read(driver, 0.8)
    assert driver.fault is None


def test_no_sync_says_what_to_do(source, channel):
    driver = source()
    with can.Bus(interface='virtual', channel=channel) as bus:
        driver.read(0.01)
        bus.send(canopen.frame(0x701, b'\x05'))
        driver.read(0.01)
        assert driver.fault == f'no SYNC 0x80 on virtual {channel}: no other master makes it, ' \
            'and can.sync is consume'
    assert driver.read(REASON_HOLD + 0.1) is None
    assert driver.fault == f'no frames on virtual {channel}'


def test_an_interface_unknown_to_python_can_is_refused():
    with pytest.raises(SettingError, match="'can.interface' is 'nonsense'; expected one of"):
        make_source('can', values(can__interface='nonsense'))


@pytest.mark.parametrize(('epoch', 'drift'), [(0.0, 0.0), (12.5, 50e-6), (12.5, -50e-6)])
def test_receive_times_of_a_devices_own_epoch_are_carried_over(epoch, drift):
    """The stamp never lies before the frame, and lags by no more than the least delay."""
    clock = ReceiveClock()
    start = 1_760_000_000.0
    worst = 0.0
    for number in range(5000):
        true = start + number * 1e-3
        received = true if not epoch else epoch + number * 1e-3 * (1.0 + drift)
        arrived = true + 1e-4 + (7e-3 if number % 100 < 5 else 0.0)
        error = abs(clock.epoch(received, arrived) - true)
        if number >= 10:  # the first have nothing to be held against
            worst = max(worst, error)
    assert worst < (1e-9 if not epoch else 2.2e-4)


def test_an_interface_without_times_gets_those_of_arrival():
    assert ReceiveClock().epoch(0.0, 1_760_000_000.0) == 1_760_000_000.0


def test_own_epoch_on_a_live_bus(source, channel):
    """Frames stamped by a device that counts from its start: samples stamped with ROS time."""
    with can.Bus(interface='virtual', channel=channel, preserve_timestamps=True) as bus:
        driver = source()
        driver.read(0.01)
        switched_on = time.time() - 3.0
        for _ in range(20):
            now = time.time()
            device = now - switched_on
            for message in (canopen.frame(0x80), *(
                    can.Message(arbitration_id=layout.can_id, is_extended_id=False,
                                data=layout.data(0.1)) for layout in LAYOUTS)):
                message.timestamp = device
                bus.send(message)
            sample = driver.read(0.1)
            assert sample is not None
            assert -1e-3 < sample.stamp * 1e-9 - now < 0.05
            time.sleep(max(0.0, 0.01 - (time.time() - now)))
