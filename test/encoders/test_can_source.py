# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A live bus: SYNC made and followed, nodes started, losses reported and recovered from."""

import threading
import time

import can
from encoder_frames import LAYOUTS, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.nodes.source_factory import make_source

# s; a busy machine may need so long for what takes a fraction of a second on an idle one.
LIMIT = 20.0


def read(source, seconds):
    """Return the sets that come within some seconds."""
    end, got = time.monotonic() + seconds, []
    while time.monotonic() < end:
        sample = source.read(0.02)
        if sample is not None:
            got.append(sample)
    return got


def read_until(source, condition):
    """Return the sets that come until the condition holds; fail if it never does."""
    end, got = time.monotonic() + LIMIT, []
    while not condition():
        assert time.monotonic() < end, f'never: fault {source.fault}, caution {source.caution}'
        sample = source.read(0.01)
        if sample is not None:
            got.append(sample)
    return got


def read_sets(source, count):
    """Read so many sets."""
    got = []
    end = time.monotonic() + LIMIT
    while len(got) < count:
        assert time.monotonic() < end, f'only {len(got)} sets: {source.fault}'
        sample = source.read(0.02)
        if sample is not None:
            got.append(sample)
    return got


def test_sync_made_here_brings_coherent_sets(source, encoders):
    rig = encoders()
    driver = source(can__sync='produce', rate=200.0)
    got = read_sets(driver, 100)
    assert driver.fault is None
    figures = driver.statistics()
    assert figures['SYNC sent'] >= 100
    assert figures["another master's SYNC"] == 0
    late = [float(part) for part in figures['SYNC sent late p50 / p99 / max (us)'].split(' / ')]
    assert 0.0 <= late[0] <= late[1] <= late[2]
    # Each set has a SYNC of its own, in order, and was read after it.
    stamps = [sample.stamp for sample in got]
    assert sorted(set(stamps)) == stamps
    assert stamps[-1] < time.time_ns()
    assert sum(message.arbitration_id == 0x80 for message in rig.heard) >= 100


def test_nodes_are_started_and_stopped_where_configured(source, encoders):
    rig = encoders()
    driver = source(can__sync='produce', rate=100.0, can__nmt_stop=True)
    read_sets(driver, 3)
    driver.close()
    end = time.monotonic() + LIMIT

    def commands():
        return [(m.data[0], m.data[1]) for m in rig.heard if m.arbitration_id == 0]

    while commands()[-1] != (canopen.NMT_STOP, 4) and time.monotonic() < end:
        time.sleep(0.005)
    assert {(canopen.NMT_START, n) for n in (1, 2, 3, 4)} <= set(commands())
    assert commands()[-4:] == [(canopen.NMT_STOP, n) for n in (1, 2, 3, 4)]


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
    read_sets(driver, 3)
    assert driver.caution is None
    stop = threading.Event()

    def master():
        with can.Bus(interface='virtual', channel=channel) as bus:
            while not stop.wait(0.01):
                bus.send(canopen.frame(0x80))

    thread = threading.Thread(target=master, daemon=True)
    thread.start()
    read_until(driver, lambda: driver.caution is not None)
    read(driver, 0.1)
    before = driver.statistics()['SYNC sent']
    got = read_sets(driver, 20)
    assert got[-1].stamp - got[0].stamp > 0.15e9
    assert 'another master makes SYNC' in driver.caution
    assert driver.statistics()['SYNC sent'] == before
    assert driver.statistics()["another master's SYNC"] > 10
    stop.set()
    thread.join()
    # It takes SYNC up again when the other has gone.
    read_until(driver, lambda: driver.statistics()['SYNC sent'] > before + 10)
    assert 'another master' not in (driver.caution or '')


def test_a_rebooting_node_is_started_again(source, encoders):
    rig = encoders('reboot:joint_1c@0.1+0.1')
    driver = source(can__sync='produce', rate=100.0)

    def starts():
        return sum(m.arbitration_id == 0 and m.data[1] == 3 for m in rig.heard)

    read_until(driver, lambda: driver.statistics()['joint_1c boot-ups'] > 0 and starts() > 1)
    read_sets(driver, 5)
    assert driver.fault is None


@pytest.mark.parametrize('stops', [False, True])
def test_an_emergency_is_reported_and_stops_where_configured(source, channel, encoders, stops):
    encoders()
    driver = source(can__sync='produce', rate=100.0, can__emcy_stops=stops)
    read_sets(driver, 3)
    words = 'joint_3a: EMCY 0x5000 device hardware, error register 0x01'
    with can.Bus(interface='virtual', channel=channel) as bus:
        bus.send(canopen.emcy(4, 0x5000, 1))
        # Late answers of a busy machine may be another caution.
        read_until(driver, lambda: words in ((driver.fault if stops else driver.caution) or ''))
        if stops:
            assert read(driver, 0.1) == []
        else:
            read_sets(driver, 3)
        assert words.split(': ')[1] in driver.statistics()['joint_3a EMCY']
        bus.send(canopen.emcy(4, 0, 0))
        read_until(driver, lambda: words not in (driver.caution or ''))
    read_sets(driver, 3)
    assert driver.fault is None


def test_a_missing_bus_is_opened_later():
    """A socketcan interface that is missing: tried again and again, never a hot loop."""
    driver = make_source('can', values(can__interface='socketcan', can__channel='can_nowhere'))
    began = time.monotonic()
    assert driver.read(0.3) is None
    assert time.monotonic() - began >= 0.3
    assert driver.fault.startswith('socketcan can_nowhere: ')
    assert driver.statistics()['bus opened'] == 0
    driver.close()
    driver.close()


def test_an_interface_unknown_to_python_can_is_refused():
    with pytest.raises(SettingError, match="'can.interface' is 'nonsense'; expected one of"):
        make_source('can', values(can__interface='nonsense'))


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
            sample = driver.read(LIMIT)
            assert sample is not None
            # Behind by the least delay, which is long where the machine is busy.
            assert -1e-3 < sample.stamp * 1e-9 - now < 1.0
            time.sleep(max(0.0, 0.01 - (time.time() - now)))
