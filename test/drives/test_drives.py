# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Drives against simulated ones in simulated time: start-up, proof, torques, faults."""

from collections import deque
from math import inf, nan
import random

import can
from drive_rig import make_test_plan, MS, Rig
import pytest
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.simulated_drive import SimulatedDrive
from spm_haptic_master.timing import Periodic

ZERO = (0.0, 0.0, 0.0)
TORQUES = (0.1, -0.2, 0.05)
# Time after which every start-up is over (s).
STARTED = 3.0


@pytest.fixture
def starting():
    """Give drives that have just been switched on."""
    with Rig() as rig:
        yield rig


@pytest.fixture
def rig(starting):
    """Give drives that make the torques."""
    starting.ready()
    starting.run(TORQUES, 0.05)
    return starting


# Start-up ---------------------------------------------------------------------------------


@pytest.mark.parametrize('combined', [False, True])
def test_after_the_proof_the_drives_make_the_torques(combined):
    with Rig(
        plan=make_test_plan(
            drives__combined=combined, drives__direction=[1, -1, 1], drives__gear=[1.0, 2.0, 1.0]
        )
    ) as rig:
        rig.ready()
        report = rig.run(TORQUES, 0.03)
        assert report.ready
        assert report.fault is None
        # 0.5 N m rated: 2 per mille a mN m; the second one with a gear of 2 and reversed.
        assert [drive.torque for drive in rig.drive] == [200, 200, 100]
        assert report.torques == pytest.approx(TORQUES, abs=1e-9)
        assert report.seconds_since_status <= 5 * MS


def test_no_torque_goes_out_before_the_drives_have_fallen_out_without_frames(starting):
    states = []
    while not (starting.report and starting.report.ready):
        starting.step(TORQUES)
        states.append(tuple(drive.state for drive in starting.drive))
    all_on = (State.ENABLED,) * 3
    assert (State.DISABLED,) * 3 in states[states.index(all_on) :]
    # Three frames of the sample in which they became ready.
    *before, first, second, third = [torque for _, torque in starting.commands()]
    assert (first, second, third) == (200, -400, 100)
    assert len(before) > 30
    assert set(before) == {0}


def test_a_drive_that_goes_on_without_frames_gets_no_torque():
    with Rig(faults=(parse_fault('drive_deaf:joint_1b@0'),)) as rig:
        report = rig.run(TORQUES, 5.0)
        assert not report.ready
        assert report.fault.startswith(
            'drive of joint_1b (node 12) did not leave Operation enabled without frames of this '
            'master; expected within 28 ms by its event timer'
        )
        assert {torque for _, torque in rig.commands()} == {0}
        assert all(drive.state is State.DISABLED for drive in rig.drive)


def test_a_drive_that_boots_in_the_pause_has_not_fallen_out(starting):
    drive = starting.drive[1]
    while drive.state is not State.ENABLED:
        starting.step(TORQUES)
    starting.run(TORQUES, 0.01)
    starting.other.send(canopen.frame(canopen.HEARTBEAT_BASE + 12, bytes(1)))
    report = starting.run(TORQUES, 1.0)
    assert report.fault == (
        'drive of joint_1b (node 12) booted during the start-up: its settings are lost'
    )
    assert {torque for _, torque in starting.commands()} == {0}


def is_read_back(rig):
    """Return whether the first drive was read back: the second one is asked."""
    return any(message.arbitration_id == 0x60C for _, message in rig.sent)


def is_about_to_be_enabled(rig):
    """Return whether a drive is on its way to Operation enabled, for the proof."""
    return rig.drive[0].state is State.SWITCHED_ON


def has_passed_the_proof(rig):
    """Return whether frames go out again after the pause."""
    times = [at for at, message in rig.sent if message.arbitration_id == 0x20B]
    return len(times) > 1 and times[-1] - times[-2] > 9 * MS


@pytest.mark.parametrize('moment', [is_read_back, is_about_to_be_enabled, has_passed_the_proof])
def test_a_drive_that_boots_in_the_start_up_gets_no_torque(starting, moment):
    """It starts by itself, and has lost what was read back, such as its largest torque."""
    drive = starting.drive[0]
    while not moment(starting):
        starting.step(TORQUES)
    starting._put(drive.boot())
    drive.nmt = canopen.OPERATIONAL
    report = starting.run(TORQUES, STARTED)
    assert report.fault == (
        'drive of joint_1a (node 11) booted during the start-up: its settings are lost'
    )
    assert {torque for _, torque in starting.commands()} <= {0}
    starting.drives.acknowledge()
    starting.ready(TORQUES)


@pytest.mark.parametrize(('late', 'serial'), [(0.0, 77), (45 * MS, 77), (0.0, 12)])
def test_two_drives_with_one_node_id_get_no_torque(starting, late, serial):
    """The second one is none of the checked ones, and would make the torque, too."""
    twin = SimulatedDrive(starting.plan, starting.plan.drives[1], factory=False)
    twin.objects.show(canopen.SERIAL_NUMBER, serial)
    receive = starting.simulation.receive
    # Answers of the twin, and when they go out (s).
    waiting = deque()

    def receive_both(message, now):
        waiting.extend((now + late, answer) for answer in twin.receive(message, now))
        return receive(message, now)

    starting.simulation.receive = receive_both
    while starting.report is None or starting.report.fault is None:
        starting.step(TORQUES)
        while waiting and waiting[0][0] < starting.now:
            starting._put([waiting.popleft()[1]])
        assert not starting.report.ready
    assert starting.report.fault.startswith(
        'drive of joint_1b (node 12): two devices have node id 12: give each its own'
    )
    assert starting.commands() == []


def test_drives_that_another_program_commands_are_left_to_it(rig):
    """As with a force_check beside a running master: it must not end the torque of that."""
    second = Drives(rig.plan, rig.open_bus, 'virtual second', None)
    for _ in range(round(1.0 / MS)):
        report = second.step(TORQUES, rig.now)
        rig.step(TORQUES)
        assert rig.report.ready
        assert not report.ready
    assert report.fault == (
        'another program sends the heartbeat of node 126 (drives.master_id): '
        'end it, it commands the drives'
    )
    second.close()
    # Once the other one has ended, it can be acknowledged.
    rig.drives.close()
    second = Drives(rig.plan, rig.open_bus, 'virtual second', None)
    rig.drives = second
    rig.ready()


def test_a_drive_in_another_mode_is_not_enabled_for_the_proof(starting):
    drive = starting.drive[1]
    value = drive.objects.value
    drive.objects.value = lambda index, sub: 3 if index == 0x6060 else value(index, sub)
    enabled = 0
    while not (starting.report and starting.report.fault):
        starting.step(TORQUES)
        enabled += drive.state is State.ENABLED
    assert enabled < 10
    assert 'another mode (3); expected cyclic synchronous' in starting.report.fault
    assert {torque for _, torque in starting.commands()} == {0}


@pytest.mark.parametrize(('late', 'ready'), [(2, True), (3, False)])
def test_one_of_three_proofs_has_to_be_in_time(starting, late, ready):
    """A proof is late by the heartbeat, in place of the event timer; this machine may be, too."""
    drive = starting.drive[2]
    proofs = 0
    value = drive.objects.value
    drive.objects.value = lambda index, sub: (
        0 if (index, sub) == (0x1400, 5) and proofs <= late else value(index, sub)
    )
    while not (starting.report and (starting.report.ready or starting.report.fault)):
        before = drive.state
        starting.step(ZERO)
        proofs += drive.state is State.ENABLED and before is not State.ENABLED
    assert starting.report.ready is ready
    if not ready:
        assert '(node 13) left Operation enabled after 49 ms without' in starting.report.fault


def test_drives_send_their_status_on_sync_of_this_master():
    with Rig(plan=make_test_plan(drives__status_by='sync')) as rig:
        rig.ready()
        report = rig.run(TORQUES, 0.05)
        assert report.ready
        assert report.seconds_since_status <= 5 * MS
        since = rig.now - 0.04
        syncs = [at for at, each in rig.sent if each.arbitration_id == 0x80 and at >= since]
        assert len(syncs) == pytest.approx(10, abs=1)
        rig.drives._syncs = Periodic(inf)
        report = rig.run(TORQUES, 0.05)
        assert 'no status frame for' in report.fault


def test_an_event_timer_that_is_missing_is_proven_by_the_heartbeat():
    with Rig(plan=make_test_plan(drives__verified_by_hand='0x1400:05')) as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        rig.paused = True
        stopped = rig.now
        while any(drive.state is State.ENABLED for drive in rig.drive):
            rig.step(TORQUES)
        assert rig.now - stopped <= 0.062


def test_without_an_event_timer_the_heartbeat_proves_it():
    with Rig(plan=make_test_plan(drives__event_timer=0.0)) as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        rig.paused = True
        stopped = rig.now
        while any(drive.state is State.ENABLED for drive in rig.drive):
            rig.step(TORQUES)
        assert rig.now - stopped <= 0.062


def test_drives_that_are_off_are_waited_for(starting):
    for drive in starting.drive:
        drive.faults['drive_unplug'] = 0.0
    report = starting.run(TORQUES, 2.0)
    assert report.fault == 'drive of joint_1a (node 11) does not answer SDO 0x1000:00'
    for drive in starting.drive:
        drive.faults.clear()
    starting.ready(TORQUES)
    assert starting.report.fault is None


@pytest.mark.parametrize(
    ('key', 'value', 'words'),
    [
        ((0x6007, 0), 3, '0x6007:00 abort connection option: 3, wanted 2'),
        ((0x6076, 0), 400, '0x6076:00 rated torque: 400, wanted 500'),
        ((0x1400, 5), 0, '0x1400:05 RPDO1 event timer, ms: 0, wanted 10'),
        ((0x1600, 2), 0x607A0020, '0x1600:02 RPDO1 mapping: 0x607A0020, wanted 0x60710010'),
    ],
)
def test_what_is_not_as_wanted_is_named_and_gets_no_torque(starting, key, value, words):
    objects = starting.drive[1].objects
    objects.show(key, value)
    objects._stored = dict(objects._entries)
    report = starting.run(TORQUES, STARTED)
    assert not report.ready
    assert report.fault == f'drive of joint_1b (node 12): {words} (can_setup --drives --write)'
    # Nothing but questions goes out.
    assert {message.arbitration_id for _, message in starting.sent} == {0x60B, 0x60C}


def test_a_node_that_is_no_drive_gets_no_torque(starting):
    starting.drive[0].objects.show((0x1000, 0), 0x00010196)
    assert starting.run(TORQUES, STARTED).fault == (
        'drive of joint_1a (node 11): device type 0x00010196; expected a drive (profile 402)'
    )
    assert starting.commands() == []


@pytest.mark.parametrize(
    ('modes', 'mode'),
    [
        (1 << 3, 4),
        (1 << 9, 10),
        (1 << 0, None),
    ],
)
def test_profile_torque_is_chosen_where_the_cyclic_mode_is_missing(starting, modes, mode):
    starting.drive[0].objects.show((0x6502, 0), modes)
    report = starting.run(TORQUES, STARTED)
    if mode:
        assert report.ready
        assert [drive.objects.value(0x6060, 0) for drive in starting.drive] == [mode, 10, 10]
    else:
        assert 'no mode of operation 0x6060 of torque' in report.fault


def test_a_drive_that_does_not_reach_operation_enabled_is_named(starting):
    starting.drive[1]._controlword = lambda word: []
    report = starting.run(TORQUES, STARTED)
    assert report.fault == (
        'drive of joint_1b (node 12): Switch on disabled 2 s after its start; '
        'expected Operation enabled'
    )


# Operation --------------------------------------------------------------------------------


def test_frames_that_stop_are_zero_torque_within_the_event_timer(rig):
    assert all(drive.torque for drive in rig.drive)
    rig.paused = True
    rig.run(TORQUES, 0.011)
    assert all(drive.state is State.DISABLED and not drive.torque for drive in rig.drive)
    rig.paused = False
    report = rig.run(TORQUES, 0.01)
    assert not report.ready
    assert 'EMCY 0x8250 RPDO timeout' in report.fault


def test_one_drive_fault_is_zero_torque_of_all_within_5_ms(rig):
    rig.drive[1].faults['drive'] = 0x2310
    began = rig.now
    assert rig.run_until(TORQUES, lambda report: report.fault is not None) <= 5 * MS
    rig.step(TORQUES)
    assert not any(drive.torque for drive in rig.drive)
    assert rig.report.fault == (
        'drive of joint_1b (node 12): EMCY 0x2310 continuous over current, error register 0x01'
    )
    rig.run(TORQUES, 0.5)
    assert set(rig.commands(began + 5 * MS)) == {(0, 0)}


def test_a_torque_off_its_command_is_zero_torque_after_50_ms(rig):
    rig.run((0.4, 0.0, 0.0), 0.1)
    rig.drive[0].faults['drive_torque'] = 30.0
    took = rig.run_until((0.4, 0.0, 0.0), lambda report: report.fault is not None)
    assert 0.05 <= took <= 0.06
    assert 'torque 1040 per mille for a command of 800' in rig.report.fault
    assert rig.commands(rig.now - 1.5 * MS) == [(0, 0)] * 3


def test_a_drive_whose_heartbeat_never_came_gets_no_torque_for_long(starting):
    """It answers, and falls out by its event timer; its heartbeat is off, and it booted before."""
    while starting.bus.recv(0.0) is not None:
        pass
    put = starting._put
    own = canopen.HEARTBEAT_BASE + 12
    starting._put = lambda messages: put([each for each in messages if each.arbitration_id != own])
    report = starting.run(TORQUES, STARTED)
    assert report.fault is not None
    assert report.fault.startswith('drive of joint_1b (node 12): no heartbeat for 6')


def test_a_fault_stays_until_it_is_acknowledged_and_everything_is_proven_again(rig):
    rig.drive[2].faults['drive'] = 0x3210
    report = rig.run(TORQUES, 1.0)
    assert 'DC link over-voltage' in report.fault
    assert rig.drive[2].state is State.FAULT
    rig.drives.acknowledge()
    rig.sent.clear()
    # The reset counts by its edge: it is repeated until the fault has gone.
    assert rig.run(TORQUES, 0.5).fault is None
    del rig.drive[2].faults['drive']
    rig.ready(TORQUES)
    # Read back again, and paused for the proof.
    assert any(message.arbitration_id == 0x60D for _, message in rig.sent)
    times = [at for at, message in rig.sent if message.arbitration_id == 0x20D]
    assert max(b - a for a, b in zip(times, times[1:], strict=False)) > 9 * MS


def test_without_a_fault_an_acknowledgement_changes_nothing(rig):
    rig.drives.acknowledge()
    assert rig.run(TORQUES, MS).ready


def test_no_torques_means_no_voltage(rig):
    report = rig.run(None, 0.05)
    assert not report.ready
    assert report.fault is None
    assert all(drive.state is State.DISABLED and not drive.torque for drive in rig.drive)
    rig.ready(TORQUES)
    assert rig.run(TORQUES, 0.02).torques == pytest.approx(TORQUES)


def test_beside_a_combined_frame_controlwords_go_out_with_heartbeats_and_changes():
    with Rig(plan=make_test_plan(drives__combined=True)) as rig:
        rig.ready()
        rig.run(TORQUES, 0.05)
        began = rig.now
        rig.run(TORQUES, 0.1)
        assert [word for word, _ in rig.commands(began)] == [0x0F] * 3 * 5
        began = rig.now
        rig.run(None, MS)
        assert [word for word, _ in rig.commands(began)] == [0x00] * 3


@pytest.mark.parametrize('torques', [(nan, 0.0, 0.0), (0.0, inf, 0.0)])
def test_a_torque_that_is_not_finite_is_a_fault(rig, torques):
    began = rig.now
    rig.step(torques)
    assert not rig.report.ready
    assert 'expected finite ones' in rig.report.fault
    assert {torque for _, torque in rig.commands(began)} == {0}


def test_a_torque_above_the_limit_is_limited(rig):
    rig.run((5.0, -5.0, 0.0), 0.02)
    assert [drive.torque for drive in rig.drive] == [1000, -1000, 0]


def test_a_foreign_frame_of_the_same_identifier_is_no_status(rig):
    rig.other.send(canopen.frame(0x18B, b'\x08\0'))
    for kind in ('is_extended_id', 'is_remote_frame', 'is_error_frame'):
        rig.other.send(
            can.Message(
                arbitration_id=0x18B,
                data=b'\x08\0\0\0\x0a',
                **{'is_extended_id': False, kind: True},
            )
        )
    assert rig.run(TORQUES, 0.01).fault is None


def test_closing_sends_zero_torque_and_then_disables_the_voltage(rig):
    rig.drives.close()
    last = []
    while (message := rig.other.recv(0.0)) is not None:
        if message.arbitration_id == 0x20B:
            last.append(bytes(message.data).hex())
    assert last == ['0f000000', '00000000']


def test_nothing_goes_out_after_closing(rig):
    """A sample may come while the process ends."""
    rig.drives.close()
    opened = []
    rig.drives._open_bus = lambda: opened.append(rig.now) or rig.bus
    rig.sent.clear()
    while rig.other.recv(0.0) is not None:
        pass
    for _ in range(2):
        report = rig.run(TORQUES, 2.0)
        assert not report.ready
        assert report.fault is not None
        rig.drives.acknowledge()
    assert not opened
    assert not rig.sent


def test_closing_after_a_fault_enables_nothing(rig):
    rig.drive[1].faults['drive'] = 0x2310
    rig.run(TORQUES, 0.1)
    rig.drives.close()
    rig.sent.clear()
    rig.step(TORQUES)
    assert set(rig.commands()) == {(0, 0)}


def lose_settings(rig, drive):
    """Have a drive boot with another cap; it starts by itself, as some do."""
    rig._put(drive.boot())
    drive.nmt = canopen.OPERATIONAL
    drive.objects.show(cia402.MAXIMUM_TORQUE, 3000)


MISHAPS = (
    lose_settings,
    lambda rig, drive: rig._put(drive.boot()),
    lambda rig, drive: rig._put(drive._fail(0x2310)),
    lambda rig, drive: setattr(drive, 'state', State.READY),
    lambda rig, drive: drive.objects.show(cia402.MODE, 3),
)


@pytest.mark.parametrize('seed', range(3))
def test_whatever_happens_no_torque_goes_to_a_drive_without_its_settings(seed):
    """Each mishap is heard in the sample that follows it."""
    draw = random.Random(seed)
    torques = 0
    with Rig() as rig:
        cap = rig.plan.drives[0].cap
        for _ in range(8000):
            if draw.random() < 0.002:
                draw.choice(MISHAPS)(rig, draw.choice(rig.drive))
            if draw.random() < 0.001:
                for drive in rig.drive:
                    drive.objects.show(cia402.MAXIMUM_TORQUE, cap)
            if draw.random() < 0.01:
                rig.drives.acknowledge()
            rig.sent.clear()
            rig.step(TORQUES)
            if any(torque for _, torque in rig.commands()):
                torques += 1
                assert rig.report.fault is None
                assert {drive.objects.value(*cia402.MAXIMUM_TORQUE) for drive in rig.drive} == {
                    cap
                }
    assert torques > 300


# Bus --------------------------------------------------------------------------------------


@pytest.mark.parametrize('refused', [0x20B, 0x20C, 0x20D])
def test_a_frame_that_is_refused_is_zero_torque_of_all_in_the_same_sample(rig, refused):
    send = rig.bus.send

    def refuse(message, timeout):
        if message.arbitration_id == refused:
            raise can.CanOperationError('Transmit buffer full')
        send(message, timeout)

    rig.bus.send = refuse
    rig.sent.clear()
    assert 'not sent: Transmit buffer full' in rig.run(TORQUES, MS).fault
    last = {message.arbitration_id: bytes(message.data) for _, message in rig.sent}
    others = {0x20B, 0x20C, 0x20D} - {refused}
    assert {identifier: last[identifier] for identifier in others} == dict.fromkeys(
        others, bytes(4)
    )


@pytest.mark.parametrize(('seconds', 'identifier'), [(0.07, 0x60B), (STARTED, 0x20B)])
def test_a_full_buffer_is_a_fault_and_ends_the_start_up(starting, seconds, identifier):
    def full(message, timeout):
        raise can.CanOperationError('Transmit buffer full')

    starting.run(TORQUES, seconds)
    send = starting.bus.send
    starting.bus.send = full
    starting.run(TORQUES, 5 * MS)
    starting.bus.send = send
    starting.sent.clear()
    report = starting.run(TORQUES, 0.5)
    assert not report.ready
    assert report.fault == (f'virtual test: frame 0x{identifier:X} not sent: Transmit buffer full')
    # In the start-up nothing goes out any more, after it no torque.
    assert set(starting.commands()) <= {(0, 0)}
    assert bool(starting.sent) is (seconds == STARTED)


def test_a_bus_that_fails_is_opened_again_and_comes_back_by_an_acknowledgement_only(rig):
    recv = rig.bus.recv
    shutdown = rig.bus.shutdown
    open_bus = rig.drives._open_bus
    opened = []

    def fail(timeout):
        raise can.CanOperationError('bus is gone')

    rig.drives._open_bus = lambda: opened.append(rig.now) or open_bus()
    rig.bus.recv = fail
    rig.bus.shutdown = lambda: None
    gone = rig.now
    assert rig.run(TORQUES, 2 * MS).fault == 'virtual test: bus is gone'
    rig.bus.recv = recv
    rig.bus.shutdown = shutdown
    report = rig.run(TORQUES, 3.0)
    assert report.fault == 'virtual test: bus is gone'
    assert not report.ready
    assert opened == pytest.approx([gone + 1.0], abs=2 * MS)
    rig.drives.acknowledge()
    rig.ready(TORQUES)


def test_a_bus_that_cannot_be_opened_is_reported_and_tried_every_second(starting):
    opened = starting.drives._open_bus
    attempts = []

    def fail():
        attempts.append(starting.now)
        raise OSError(19, 'No such device')

    starting.drives._open_bus = fail
    report = starting.run(TORQUES, 2.5)
    assert 'virtual test' in report.fault
    assert report.seconds_since_status == inf
    assert attempts == pytest.approx([100.0, 101.0, 102.0], abs=2 * MS)
    starting.drives._open_bus = opened
    starting.ready(TORQUES)
    assert starting.report.fault is None
