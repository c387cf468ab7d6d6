# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bus that is opened, fails and is opened again; what goes out on it and when."""

import logging
import threading
import time

import can
from encoder_frames import T0, values
import pytest
from scripted_bus import (
    cycles,
    node_frame,
    POLL_PERIOD,
    REOPEN_FIRST,
    REOPEN_LAST,
    REOPEN_SILENT,
    run,
)
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_source import open_bus
from spm_haptic_master.simulation.source_factory import make_source

# s; a busy machine may need so long for what takes a fraction of a second on an idle one.
LIMIT = 20.0


def stamps(*times):
    return [pytest.approx((T0 + at) * 1e9, abs=1000) for at in times]


def read_until(source, condition):
    """Return the sets that come until the condition of them holds; fail if it never does."""
    end, got = time.monotonic() + LIMIT, []
    while not condition(got):
        assert time.monotonic() < end, f'never: fault {source.fault}, caution {source.caution}'
        sample = source.read(0.01)
        if sample is not None:
            got.append(sample)
    return got


def test_sync_is_made_here_until_a_second_master_makes_it(source, channel, encoders):
    encoders()
    driver = source(can__sync='produce', rate=100.0)
    read_until(driver, lambda got: len(got) == 30)
    figures = driver.statistics()
    assert driver.fault is None
    assert figures['SYNC sent'] >= 30 and figures["another master's SYNC"] == 0
    late = [float(part) for part in figures['SYNC sent late p50 / p99 / max (us)'].split(' / ')]
    assert 0.0 <= late[0] <= late[1] <= late[2]
    stop = threading.Event()

    def master():
        with can.Bus(interface='virtual', channel=channel) as bus:
            while not stop.wait(0.01):
                bus.send(canopen.frame(0x80))

    thread = threading.Thread(target=master, daemon=True)
    thread.start()
    read_until(driver, lambda _: 'another master makes SYNC' in (driver.caution or ''))
    read_until(driver, lambda got: len(got) == 10)
    before = driver.statistics()['SYNC sent']
    got = read_until(driver, lambda got: len(got) == 20)
    assert got[-1].stamp - got[0].stamp > 0.15e9
    assert 'another master makes SYNC' in driver.caution
    assert driver.statistics()['SYNC sent'] == before
    assert driver.statistics()["another master's SYNC"] > 10
    stop.set()
    thread.join()
    # It takes SYNC up again when the other has gone.
    read_until(driver, lambda _: driver.statistics()['SYNC sent'] > before + 10)
    assert 'another master' not in (driver.caution or '')


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


def test_sets_arrive_with_syncs_receive_time(rig):
    driver = rig(cycles(0.05, 3))
    assert driver.fault == 'virtual can7: not opened yet'
    assert [sample.stamp for sample in run(driver, 0.1)] == stamps(0.05, 0.06, 0.07)
    assert driver.fault is None
    assert driver.caution is None
    figures = driver.statistics()
    assert (figures['bus'], figures['bus opened']) == ('virtual can7', 1)
    assert 'last send refused' not in figures and 'SYNC sent' not in figures


def test_a_read_ends_at_its_timeout_and_polls_in_between(rig):
    driver = rig(())
    assert driver.read(0.05) is None
    assert driver.clock.now == pytest.approx(0.05, abs=1e-5)
    waits = driver.buses[0].waits
    assert max(waits) <= POLL_PERIOD + 1e-9
    assert len(waits) <= 5


def test_frames_without_times_get_those_of_arrival(rig):
    script = cycles(0.01, 1)
    for _, message in script:
        message.timestamp = 0.0
    assert [sample.stamp for sample in run(rig(script), 0.05)] == stamps(0.01)


def test_opening_is_tried_again_with_back_off(rig):
    driver = rig(can.CanInitializationError('no such device\nTraceback ...'))
    assert run(driver, 10.0) == []
    times = [at for at, *_ in driver.opened]
    waits = [after - before for before, after in zip(times, times[1:], strict=False)]
    assert times[0] == 0.0 and waits[-1] == pytest.approx(REOPEN_LAST)
    assert waits == [pytest.approx(min(2.0 ** n * REOPEN_FIRST, REOPEN_LAST))
                     for n in range(len(waits))]
    # In one line, whatever python-can's error has.
    assert driver.fault == 'virtual can7: no such device'
    assert driver.statistics()['bus opened'] == 0


@pytest.mark.parametrize('error', [
    can.CanOperationError(''), OSError('Network is down'), ValueError('bad'), ImportError('no x')])
def test_each_kind_of_bus_error_is_survived(rig, error):
    driver = rig([(0.01, error)], cycles(0.2, 5))

    def shutdown():
        driver.buses[0].shut += 1
        raise OSError('gone for good')

    driver.buses[0].shutdown = shutdown
    assert run(driver, 0.05) == []
    assert driver.fault == f'virtual can7: {str(error) or "CanOperationError"}'
    assert driver.buses[0].shut == 1
    assert len(run(driver, 0.25)) == 5
    assert driver.fault is None
    assert [at for at, *_ in driver.opened] == pytest.approx([0.0, 0.01 + REOPEN_FIRST])
    assert driver.statistics()['bus opened'] == 2


def test_a_frame_ends_the_back_off(rig):
    """Each time that the bus had frames before it broke, the first retry comes soon."""
    broken = OSError('gone')
    driver = rig(broken, broken, [*cycles(0.4, 1), (0.5, broken)], cycles(0.9, 2))
    run(driver, 1.0)
    assert [at for at, *_ in driver.opened] == pytest.approx(
        [0.0, REOPEN_FIRST, 3.0 * REOPEN_FIRST, 0.5 + REOPEN_FIRST])


def test_a_bus_that_dies_without_a_word_is_opened_again(rig):
    """An interface that went and came back leaves its old socket silent for ever."""
    driver = rig(cycles(0.01, 2), cycles(4.0, 2))
    assert len(run(driver, 3.9)) == 2
    assert driver.fault == 'no frames on virtual can7'
    reopened = driver.opened[1][0]
    assert 0.02 + REOPEN_SILENT < reopened < 0.02 + REOPEN_SILENT + 2 * POLL_PERIOD
    assert driver.buses[0].shut == 1
    assert len(run(driver, 4.1)) == 2
    # A bus silent from the start is opened as often.
    silent = rig(())
    begin = silent.clock.now
    run(silent, begin + 7.0)
    assert len(silent.opened) == 4


def test_a_reopened_bus_starts_a_new_cycle_and_a_new_clock(rig):
    """Answers to a SYNC from before the break never join those after; nor does its offset."""
    first, second = cycles(0.01, 1)[:3], cycles(0.01, 1)[3:]
    second = [(0.2 + number * 1e-4, message) for number, (_, message) in enumerate(second)]
    for _, message in second:
        message.timestamp = T0 + 0.2
    driver = rig([*first, (0.05, OSError('gone'))], [*second, *cycles(0.3, 1)])
    assert len(run(driver, 0.4)) == 1
    assert driver.statistics()['rejected: before the first SYNC'] == 2


def test_a_reopened_bus_may_count_from_another_start(rig):
    """A device that was switched off and on: the offset of its old times no longer holds."""
    first, second = cycles(0.01, 1), cycles(0.2, 1)
    for script, start in ((first, 5000.0), (second, 1.0)):
        for _, message in script:
            message.timestamp += start - T0
    driver = rig([*first, (0.05, OSError('gone'))], second)
    assert [sample.stamp for sample in run(driver, 0.3)] == stamps(0.01, 0.2)


def test_silent_nodes_are_started_and_booting_ones_at_once(rig):
    driver = rig([*cycles(0.005, 120, without=(1,)), node_frame(0.3011, 0x703, b'\x00')])
    run(driver, 1.19)
    starts = driver.buses[0].starts()
    # All four before any was heard; node 2 every half second; node 3 as soon as it booted.
    assert starts[:4] == [(0.0, 1), (0.0, 2), (0.0, 3), (0.0, 4)]
    assert [node for _, node in starts[4:]] == [3, 2, 2]
    assert starts[4][0] == pytest.approx(0.3011, abs=1e-6)
    for place, expected in ((5, 0.5), (6, 1.0)):
        assert -1e-6 < starts[place][0].expected - expected < 3 * POLL_PERIOD


def test_raw_encoders_are_never_started(rig):
    driver = rig((), can__protocol='raw')
    run(driver, 1.0)
    assert driver.buses[0].sent == []
    assert driver.caution is None


def test_a_refused_start_is_reported_and_not_fatal(rig):
    driver = rig(())
    driver.buses[0].refusal = can.CanOperationError('Transmit buffer full\nmore')
    run(driver, 0.1)
    assert driver.fault == 'no frames on virtual can7 (sending: Transmit buffer full)'
    assert driver.statistics()['last send refused'] == 'Transmit buffer full'
    driver.buses[0].refusal = None
    run(driver, 0.7)
    assert driver.fault == 'no frames on virtual can7'
    assert 'last send refused' not in driver.statistics()


@pytest.mark.parametrize('stop', [True, False])
def test_closing_stops_the_nodes_where_configured(rig, stop):
    driver = rig(cycles(0.01, 1), can__nmt_stop=stop)
    driver.close()
    assert driver.opened == []
    run(driver, 0.05)
    bus = driver.buses[0]
    bus.sent.clear()
    driver.close()
    driver.close()
    assert bus.shut == 1
    assert [tuple(message.data) for _, message in bus.sent] == [
        (canopen.NMT_STOP, node_id) for node_id in (1, 2, 3, 4) if stop]


@pytest.mark.parametrize(('refused', 'own', 'bitrate', 'calls'), [
    ((), False, 0, [{}]), ((), False, 500_000, [{'bitrate': 500_000}]),
    ((), True, 0, [{'receive_own_messages': True}]),
    (('receive_own_messages',), True, 125_000,
     [{'bitrate': 125_000, 'receive_own_messages': True}, {'bitrate': 125_000}]),
])
def test_a_bus_is_opened_with_what_its_interface_takes(
        monkeypatch, refused, own, bitrate, calls):
    made = []

    def bus(**given):
        made.append(given)
        if set(given) & set(refused):
            raise NotImplementedError
        return 'bus'

    monkeypatch.setattr(can, 'Bus', bus)
    logging.getLogger('can').setLevel(logging.NOTSET)
    assert open_bus('virtual', 'can7', bitrate, own) == 'bus'
    assert made == [{'interface': 'virtual', 'channel': 'can7', **call} for call in calls]
    # python-can would log what it also raises.
    assert logging.getLogger('can').level == logging.CRITICAL
