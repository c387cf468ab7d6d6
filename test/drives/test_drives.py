# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drives against simulated ones in simulated time: start-up, proof, torques, faults."""

from math import inf, nan

import can
from drive_rig import make_test_plan, MS, Rig
import pytest
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.plan import torque_frames
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.fault_injection import parse_fault

ZERO = (0.0, 0.0, 0.0)
TORQUES = (0.1, -0.2, 0.05)
# Time after which every start-up is over (s).
STARTED = 3.0


def torques_sent(rig, since):
    """Return the torques of all frames of the master since a time, per mille."""
    ids = {rig.plan.control_id(drive) for drive in rig.plan.drives}
    return [int.from_bytes(message.data[2:4], 'little', signed=True)
            for at, message in rig.sent if at >= since and message.arbitration_id in ids]


def words_sent(rig, since):
    """Return the controlwords of the master since a time."""
    ids = {rig.plan.control_id(drive) for drive in rig.plan.drives}
    return [int.from_bytes(message.data[:2], 'little')
            for at, message in rig.sent if at >= since and message.arbitration_id in ids]


@pytest.mark.parametrize('combined', [False, True])
def test_after_the_proof_the_drives_make_the_torques(combined):
    with Rig(plan=make_test_plan(drives__combined=combined, drives__direction=[1, -1, 1],
                                 drives__gear=[1.0, 2.0, 1.0])) as rig:
        rig.ready()
        report = rig.run(TORQUES, 0.03)
        assert report.ready and report.fault is None
        # 0.5 N m rated: 2 per mille a mN m; the second one with a gear of 2 and reversed.
        assert [drive.torque for drive in rig.drive] == [200, 200, 100]
        assert report.torques == pytest.approx(TORQUES, abs=1e-9)
        assert report.seconds_since_status <= 5 * MS


def test_nothing_but_questions_goes_out_before_the_drives_are_read_back():
    plan = make_test_plan()
    with Rig(factory=True) as rig:
        rig.run(TORQUES, STARTED)
        ids = {message.arbitration_id for _, message in rig.sent}
        assert ids == {0x600 + plan.drives[0].node_id}
        assert not rig.report.ready


def test_no_torque_goes_out_before_the_proof():
    with Rig() as rig:
        rig.run_until(TORQUES, lambda report: report.ready)
        # Three frames of the sample in which they became ready.
        *before, first, second, third = torques_sent(rig, 0.0)
        assert (first, second, third) == (200, -400, 100)
        assert len(before) > 30 and set(before) == {0}


def test_the_start_up_pauses_until_every_drive_has_fallen_out():
    with Rig() as rig:
        states = []
        while not (rig.report and rig.report.ready):
            rig.step(ZERO)
            states.append(tuple(drive.state for drive in rig.drive))
        all_on = (State.ENABLED,) * 3
        assert all_on in states
        first = states.index(all_on)
        assert (State.DISABLED,) * 3 in states[first:]


def test_a_drive_that_goes_on_without_frames_gets_no_torque():
    with Rig(faults=(parse_fault('drive_deaf:joint_1b@0'),)) as rig:
        report = rig.run(TORQUES, 5.0)
        assert not report.ready
        assert report.fault.startswith(
            'drive of joint_1b (node 12) did not leave Operation enabled without frames of this '
            'master; expected within 28 ms by its event timer')
        assert set(torques_sent(rig, 0.0)) == {0}
        assert all(drive.state is State.DISABLED for drive in rig.drive)


def test_a_drive_that_falls_out_too_late_is_named_with_its_time():
    """Its event timer is not what it says: the proof measures."""
    with Rig() as rig:
        slow = rig.drive[2]
        value = slow.objects.value
        slow.objects.value = lambda index, sub: 200 if (index, sub) == (0x1400, 5) \
            else 0 if index == 0x1016 else value(index, sub)
        report = rig.run(TORQUES, 5.0)
        assert not report.ready
        assert 'drive of joint_1c (node 13) left Operation enabled after 20' in report.fault


def test_without_an_event_timer_the_heartbeat_proves_it():
    plan = make_test_plan(drives__event_timer=0.0)
    with Rig(plan=plan) as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        rig.paused = True
        stopped = rig.now
        while any(drive.state is State.ENABLED for drive in rig.drive):
            rig.step(TORQUES)
        assert rig.now - stopped <= 0.062


def test_frames_that_stop_are_zero_torque_within_the_event_timer():
    with Rig() as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        assert all(drive.torque for drive in rig.drive)
        rig.paused = True
        rig.run(TORQUES, 0.011)
        assert not any(drive.torque for drive in rig.drive)
        assert all(drive.state is State.DISABLED for drive in rig.drive)
        rig.paused = False
        report = rig.run(TORQUES, 0.01)
        assert not report.ready and 'EMCY 0x8250 RPDO timeout' in report.fault


def test_one_drive_fault_is_zero_torque_of_all_within_5_ms():
    with Rig() as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        rig.drive[1].faults['drive'] = 0x2310
        began = rig.now
        rig.run_until(TORQUES, lambda report: report.fault is not None)
        assert rig.now - began <= 5 * MS
        rig.step(TORQUES)
        assert not any(drive.torque for drive in rig.drive)
        assert rig.report.fault == ('drive of joint_1b (node 12): EMCY 0x2310 continuous over '
                                    'current, error register 0x01')
        rig.run(TORQUES, 0.5)
        assert set(torques_sent(rig, began + 5 * MS)) == {0}
        assert set(words_sent(rig, began + 5 * MS)) == {0}


def test_a_drive_without_power_is_noticed_by_its_status_and_heartbeat():
    with Rig() as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        rig.drive[0].faults['drive_unplug'] = 0.0
        took = rig.run_until(TORQUES, lambda report: report.fault is not None)
        assert took <= 0.03
        assert 'drive of joint_1a (node 11): no status frame for 2' in rig.report.fault
        rig.run(TORQUES, 2 * MS)
        assert not any(drive.torque for drive in rig.drive[1:])


def test_a_heartbeat_that_stops_is_a_fault_although_status_frames_come():
    with Rig() as rig:
        rig.ready()
        rig.drive[0].objects.show((0x1017, 0), 0)
        took = rig.run_until(TORQUES, lambda report: report.fault is not None)
        assert took <= 0.085
        assert 'drive of joint_1a (node 11): no heartbeat for 6' in rig.report.fault


@pytest.mark.parametrize(('share', 'fails'), [(30.0, True), (10.0, False)])
def test_a_torque_off_its_command_by_a_fifth_for_50_ms_is_a_fault(share, fails):
    with Rig() as rig:
        rig.ready()
        rig.run((0.4, 0.0, 0.0), 0.1)
        rig.drive[0].faults['drive_torque'] = share
        began = rig.now
        rig.run((0.4, 0.0, 0.0), 0.2)
        assert (rig.report.fault is not None) is fails
        if fails:
            assert 'torque 1040 per mille for a command of 800' in rig.report.fault
            first_zero = next(at for at, message in rig.sent if at > began
                              and message.arbitration_id == 0x20B and not any(message.data[2:4]))
            assert 0.05 <= first_zero - began <= 0.06


def test_a_command_that_changes_fast_is_no_deviation():
    """The status frames are up to 5 ms late: 10 N m/s are 50 mN m in that time."""
    with Rig() as rig:
        rig.ready()
        torque, slope = 0.0, 0.01
        for _ in range(1000):
            torque += slope
            if abs(torque) >= 0.45:
                slope = -slope
            rig.step((torque, -torque, 0.0))
        assert rig.report.fault is None


def test_a_fault_stays_until_it_is_acknowledged_and_everything_is_proven_again():
    with Rig() as rig:
        rig.ready()
        rig.drive[2].faults['drive'] = 0x3210
        rig.run(TORQUES, 0.1)
        del rig.drive[2].faults['drive']
        report = rig.run(TORQUES, 1.0)
        assert 'DC link over-voltage' in report.fault
        assert rig.drive[2].state is State.FAULT
        rig.drives.acknowledge()
        rig.sent.clear()
        rig.ready(TORQUES)
        # Read back again, and paused for the proof.
        assert any(message.arbitration_id == 0x60D for _, message in rig.sent)
        times = [at for at, message in rig.sent if message.arbitration_id == 0x20D]
        assert max(b - a for a, b in zip(times, times[1:], strict=False)) > 9 * MS


def test_a_fault_that_lasts_is_reset_when_it_has_gone():
    """The reset counts by its edge: it is repeated."""
    with Rig() as rig:
        rig.ready()
        rig.drive[2].faults['drive'] = 0x3210
        rig.run(TORQUES, 0.1)
        rig.drives.acknowledge()
        rig.run(TORQUES, 0.5)
        del rig.drive[2].faults['drive']
        rig.ready(TORQUES)


def test_without_a_fault_an_acknowledgement_changes_nothing():
    with Rig() as rig:
        rig.ready(TORQUES)
        rig.drives.acknowledge()
        assert rig.run(TORQUES, MS).ready


def test_no_torques_means_no_voltage():
    with Rig() as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        report = rig.run(None, 0.05)
        assert not report.ready and report.fault is None
        assert all(drive.state is State.DISABLED and not drive.torque for drive in rig.drive)
        rig.ready(TORQUES)
        assert rig.run(TORQUES, 0.02).torques == pytest.approx(TORQUES)


def test_a_drive_that_boots_is_a_fault():
    with Rig() as rig:
        rig.ready()
        for message in rig.drive[0].boot():
            rig.other.send(message)
        report = rig.run(TORQUES, 0.01)
        assert report.fault == ('drive of joint_1a (node 11): booted: it has lost what it was set '
                                'to')


def test_a_drive_that_leaves_by_itself_is_a_fault():
    with Rig() as rig:
        rig.ready()
        rig.drive[1].state = State.DISABLED
        took = rig.run_until(TORQUES, lambda report: report.fault is not None)
        assert took <= 5 * MS
        assert rig.report.fault == ('drive of joint_1b (node 12): left Operation enabled (Switch '
                                    'on disabled)')


@pytest.mark.parametrize('torques', [(nan, 0.0, 0.0), (0.0, inf, 0.0)])
def test_a_torque_that_is_not_finite_is_a_fault(torques):
    with Rig() as rig:
        rig.ready()
        began = rig.now
        rig.step(torques)
        assert not rig.report.ready and 'expected finite ones' in rig.report.fault
        assert set(torques_sent(rig, began)) == {0}


def test_a_torque_above_the_limit_is_limited():
    with Rig() as rig:
        rig.ready()
        rig.run((5.0, -5.0, 0.0), 0.02)
        assert [drive.torque for drive in rig.drive] == [1000, -1000, 0]


class FullBus:
    """A bus whose buffer is full when it is told so."""

    def __init__(self, bus):
        self._bus = bus
        self.full = False

    def recv(self, timeout):
        return self._bus.recv(timeout)

    def send(self, message, timeout):
        if self.full:
            raise can.CanOperationError('Transmit buffer full')
        self._bus.send(message, timeout)

    def shutdown(self):
        self._bus.shutdown()


def test_a_full_buffer_is_a_fault_and_no_exception():
    with Rig() as rig:
        full = rig.bus = FullBus(rig.bus)
        rig.ready()
        full.full = True
        report = rig.run(TORQUES, 2 * MS)
        assert not report.ready
        assert report.fault == 'virtual test: frame 0x20B not sent: Transmit buffer full'


def test_a_bus_that_fails_is_a_fault_and_comes_back_by_an_acknowledgement_only():
    with Rig() as rig:
        rig.ready()
        recv, rig.bus.recv = rig.bus.recv, None

        def fail(timeout):
            raise can.CanOperationError('bus is gone')

        shutdown, rig.bus.shutdown = rig.bus.shutdown, lambda: None
        rig.bus.recv = fail
        report = rig.run(TORQUES, 2 * MS)
        assert report.fault == 'virtual test: bus is gone'
        rig.bus.recv, rig.bus.shutdown = recv, shutdown
        report = rig.run(TORQUES, 3.0)
        assert report.fault == 'virtual test: bus is gone' and not report.ready
        rig.drives.acknowledge()
        rig.ready(TORQUES)


def test_a_bus_that_cannot_be_opened_is_reported_and_tried_again():
    with Rig() as rig:
        opened, attempts = rig.drives._open_bus, []

        def fail():
            attempts.append(rig.now)
            raise OSError(19, 'No such device')

        rig.drives._open_bus = fail
        report = rig.run(TORQUES, 2.5)
        assert 'virtual test' in report.fault and report.seconds_since_status == inf
        assert len(attempts) == 3
        rig.drives._open_bus = opened
        rig.ready(TORQUES)


def test_drives_that_are_off_are_waited_for():
    with Rig() as rig:
        for drive in rig.drive:
            drive.faults['drive_unplug'] = 0.0
        report = rig.run(TORQUES, 2.0)
        assert report.fault == 'drive of joint_1a (node 11) does not answer SDO 0x1000:00'
        for drive in rig.drive:
            drive.faults.clear()
        rig.ready(TORQUES)


@pytest.mark.parametrize(('changes', 'words'), [
    ({(0x6007, 0): 3}, '0x6007:00 abort connection option: 3, wanted 2'),
    ({(0x6076, 0): 400}, '0x6076:00 rated torque: 400, wanted 500'),
    ({(0x6072, 0): 2000}, '0x6072:00 maximum torque, per mille: 2000, wanted 1000'),
    ({(0x605A, 0): 2}, '0x605A:00 quick stop option: 2, wanted 0'),
    ({(0x605E, 0): 2}, '0x605E:00 fault reaction option: 2, wanted 0'),
    ({(0x1400, 5): 0}, '0x1400:05 RPDO1 event timer, ms: 0, wanted 10'),
    ({(0x1016, 1): 0}, "0x1016:01 master's heartbeat: 0x0, wanted 0x7E003C"),
    ({(0x1017, 0): 0}, '0x1017:00 heartbeat time, ms: 0, wanted 20'),
    ({(0x1600, 2): 0x607A0020}, '0x1600:02 RPDO1 mapping: 0x607A0020, wanted 0x60710010')])
def test_what_is_not_as_wanted_is_named_and_gets_no_torque(changes, words):
    with Rig() as rig:
        for key, value in changes.items():
            rig.drive[1].objects.show(key, value)
            rig.drive[1].objects._stored = dict(rig.drive[1].objects._entries)
        report = rig.run(TORQUES, STARTED)
        assert not report.ready
        assert report.fault == f'drive of joint_1b (node 12): {words} (can_setup --write)'
        assert torques_sent(rig, 0.0) == []


def test_profile_torque_is_chosen_where_the_cyclic_mode_is_missing():
    with Rig() as rig:
        rig.drive[0].objects.show((0x6502, 0), 1 << 3)
        rig.ready(TORQUES)
        assert rig.drive[0].objects.value(0x6060, 0) == 4
        assert rig.drive[1].objects.value(0x6060, 0) == 10
    with Rig() as rig:
        rig.drive[0].objects.show((0x6502, 0), 1 << 0)
        report = rig.run(TORQUES, STARTED)
        assert 'no mode of operation 0x6060 of torque' in report.fault


def test_another_mode_than_the_one_set_is_a_fault():
    with Rig() as rig:
        rig.ready()
        rig.drive[2].objects.show((0x6060, 0), 8)
        report = rig.run(TORQUES, 0.01)
        assert report.fault == ('drive of joint_1c (node 13): mode of operation another mode (8); '
                                'expected cyclic synchronous torque (10)')


def test_too_much_heat_is_a_fault_of_the_simulated_drive():
    """Twice the rated torque for a second."""
    plan = make_test_plan(drives__rated_torque=[0.2])
    with Rig(plan=plan) as rig:
        rig.ready()
        took = rig.run_until((0.4, 0.0, 0.0), lambda report: report.fault is not None)
        assert took == pytest.approx(1.0, abs=0.01)
        assert 'EMCY 0x2350 I2t, load level fault' in rig.report.fault


def test_closing_sends_zero_torque_and_then_disables_the_voltage():
    with Rig() as rig:
        rig.ready()
        rig.run(TORQUES, 0.02)
        rig.drives.close()
        last = []
        while (message := rig.other.recv(0.0)) is not None:
            if message.arbitration_id == 0x20B:
                last.append(bytes(message.data).hex())
        assert last == ['0f000000', '00000000']


def test_the_frames_of_a_sample_are_laid_out_as_documented():
    plan = make_test_plan()
    assert torque_frames(plan, [0x0F, 0x06, 0x00], [1, -2, 1000], True) == [
        (0x20B, bytes.fromhex('0f000100')), (0x20C, bytes.fromhex('0600feff')),
        (0x20D, bytes.fromhex('0000e803'))]
    plan = make_test_plan(drives__combined=True)
    assert torque_frames(plan, [0x0F, 0x06, 0x00], [1, -2, 1000], False) == [
        (0x30B, bytes.fromhex('0100feffe803'))]
    assert torque_frames(plan, [0x0F, 0x06, 0x00], [1, -2, 1000], True)[1:] == [
        (0x20B, b'\x0f\0'), (0x20C, b'\x06\0'), (0x20D, b'\0\0')]


def test_a_foreign_frame_of_the_same_identifier_is_no_status():
    with Rig() as rig:
        rig.ready()
        rig.other.send(canopen.frame(0x18B, b'\x08\0'))
        rig.other.send(can.Message(arbitration_id=0x18B, is_extended_id=True,
                                   data=b'\x08\0\0\0\x0a'))
        assert rig.run(TORQUES, 0.01).fault is None
