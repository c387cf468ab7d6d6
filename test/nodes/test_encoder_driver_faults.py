# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Losses on a live bus, with real processes: what is published, and the time of each change."""

import contextlib
import signal
import socket
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import Disturbance, measure_undisturbed
from encoder_frames import LAYOUTS, values
from harness import Observer, stamp, start_program
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.encoders import canopen
from spm_haptic_master.parameter_files import simulated_rig
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus

pytestmark = pytest.mark.process

STATUS = 'encoder_driver: encoders'
RATE = 500.0
# can.timeout, and the time from there to /diagnostics (s).
TIMEOUT, REPORT = 0.03, 0.05
# Time by which a busy machine may be late (s), beside what a control thread was late.
BUSY = 0.1
# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# All of a fault's kinds that silence the driver: what the reason says. The rolling counter is in
# the encoders' fifth byte.
SILENCING = {
    'dropout:joint_3a@2+0.6': 'joint_3a silent (no frames)',
    'reboot:joint_1b@3.2+0.6': 'joint_1b silent (no frames)',
    'silence@4.4+0.6': 'all encoders silent (no frames)',
    'busoff@5.6+0.6': 'bus-off',
    'counter:joint_1c@6.8+0.6': 'joint_1c silent (frames rejected, rolling counter unchanged)',
}
GOING_ON = ('emcy:joint_1a@8+0.5=0x5000', 'offset:joint_3a@9+0.5=3', 'jump:joint_1b@9.6=20',
            'noise:joint_1c@9.8+0.4=1', 'stuck:joint_1a@10.3+0.7')
END = 11.3
LAYOUT = {'encoders.data_length': '[5, 5, 5, 5]', 'encoders.counter_byte': '[4, 4, 4, 4]',
          'encoders.counter_mask': '[0xFF, 0xFF, 0xFF, 0xFF]'}


def bus_parameters(channel):
    return {'can.interface': 'udp_multicast', 'can.channel': channel, 'rate': RATE}


def sim_bus(channel, *options, **layout):
    parameters = bus_parameters(channel) | layout
    return start_program('sim_bus', *parameter_arguments(parameters), *options)


class Watch:
    """A driver as SYNC master, and all that it publishes."""

    def __init__(self, parameters, **environment):
        self.observer = Observer()
        self.samples = self.observer.collect(JointState, 'measured_js')
        self.health = self.observer.collect(DiagnosticArray, '/diagnostics')
        self.driver = start_program('encoder_driver', parameters={
            'source': 'can', 'can.sync': 'produce', **simulated_rig(), **parameters},
            **environment)

    def stamps(self):
        """Return the samples' stamps, s."""
        return np.array([stamp(message) for _, message in self.samples]) * 1e-9

    def changes(self):
        """Return (arrival in s, level, message) of each change on /diagnostics."""
        found = []
        for arrived, array in self.health:
            for entry in array.status:
                if entry.name == STATUS and (not found or found[-1][2] != entry.message):
                    found.append((arrived * 1e-9, entry.level, entry.message))
        return found

    def message(self):
        changes = self.changes()
        return changes[-1][2] if changes else ''

    def close(self):
        code = self.driver.stop()
        self.observer.close()
        return code


def run_through_all_faults(channel):
    """Return what was published, and when each fault began and ended."""
    faults = [*SILENCING, *GOING_ON]
    # The faults' times count from the encoders' start: the driver must be up before.
    watch = Watch({**bus_parameters(channel), **LAYOUT})
    assert watch.observer.spin_until(watch.message, PATIENCE), watch.driver.stderr
    encoders = sim_bus(channel, *(word for fault in faults for word in ('--fault', fault)),
                       **LAYOUT, **{'sim.noise_deg': 0.0})
    assert watch.observer.spin_until(lambda: len(watch.samples) > 0, PATIENCE), encoders.stderr
    with Disturbance() as machine:
        watch.observer.spin(END)
    watch.lateness = machine.lateness
    watch.late = BUSY + 2.0 * machine.lateness
    watch.code = watch.close()
    encoders.stop(signal.SIGINT)
    watch.events = {}
    for line in encoders.stdout.splitlines():
        if line.endswith((' begins', ' ends')):
            when, text, what = line.split()
            watch.events[text, what] = float(when)
    return watch


def is_complete(watch):
    """Return whether no fault was passed over, nor many samples outside of them, by a stall."""
    faults = {(fault, what) for fault in (*SILENCING, *GOING_ON) for what in ('begins', 'ends')}
    if not faults <= watch.events.keys():
        return False
    stamps = watch.stamps()
    silent = sum(watch.events[fault, 'ends'] - watch.events[fault, 'begins']
                 for fault in SILENCING)
    expected = RATE * (stamps[-1] - stamps[0] - silent)
    begins = watch.events['jump:joint_1b@9.6=20', 'begins']
    return watch.lateness < TIMEOUT and len(stamps) > 0.9 * expected \
        and np.abs(stamps - begins).min() < 1.0 / RATE


@pytest.fixture(scope='module')
def session(bus_channel):
    """One run through all faults."""
    return measure_undisturbed(lambda: run_through_all_faults(bus_channel), is_complete)


def around(session, fault):
    """Return the stamps, and when the fault began and ended."""
    return session.stamps(), session.events[fault, 'begins'], session.events[fault, 'ends']


@pytest.mark.parametrize('fault', SILENCING)
def test_nothing_goes_out_and_all_comes_back(session, fault):
    stamps, begins, ends = around(session, fault)
    # Right until the fault, and nothing in it.
    assert stamps[stamps < begins + 0.01].max() > begins - 0.2 - session.late
    assert not ((stamps > begins + 0.01) & (stamps < ends - 0.01)).any()
    back = stamps[stamps > ends - 0.01].min() - ends
    print(f'{fault}: silent from {stamps[stamps < begins + 0.01].max() - begins:+.4f} s, '
          f'back after {back:.4f} s')
    assert back < 0.3 + session.late


@pytest.mark.parametrize('fault', SILENCING)
def test_the_reason_is_on_diagnostics_in_time(session, fault):
    stamps, begins, ends = around(session, fault)
    deadline = stamps[stamps < begins + 0.01].max() + TIMEOUT
    (arrived, _, message) = next(
        entry for entry in session.changes()
        if entry[0] > begins and entry[1] == DiagnosticStatus.ERROR)
    print(f'{fault}: "{message}" {1e3 * (arrived - deadline):+.1f} ms after the deadline')
    assert arrived - deadline < REPORT + session.late
    reported = [text for when, level, text in session.changes()
                if begins < when < ends and level == DiagnosticStatus.ERROR]
    assert any(SILENCING[fault] in text for text in reported)
    after = [text for when, level, text in session.changes()
             if when > ends and level != DiagnosticStatus.ERROR]
    assert after


def test_an_emergency_is_reported_in_words_while_samples_go_on(session):
    stamps, begins, ends = around(session, GOING_ON[0])
    assert ((stamps > begins) & (stamps < ends)).sum() > 0.5 * RATE * (ends - begins)
    reported = [text for when, level, text in session.changes()
                if begins < when < ends and level == DiagnosticStatus.WARN]
    assert any(text.startswith('joint_1a: EMCY 0x5000 device hardware, error register 0x01 [')
               for text in reported)


def test_wrong_angles_arrive_as_they_were_sent(session):
    """The driver rejects only what a frame shows to be wrong."""
    stamps = session.stamps()
    angles = np.degrees([message.position for _, message in session.samples])

    def during(fault, joint, margin=0.02):
        begins, ends = session.events[fault, 'begins'], session.events[fault, 'ends']
        return angles[(stamps > begins + margin) & (stamps < ends - margin), joint]

    # A step in the slow motion: fitted, because a busy machine may lose samples at the step.
    begins = session.events[GOING_ON[1], 'begins']
    near = np.abs(stamps - begins) < 0.3
    since, after = stamps[near] - begins, stamps[near] > begins
    terms = np.column_stack([np.ones(near.sum()), since, since ** 2, after])
    assert 10 < after.sum() < near.sum() - 10
    step = np.linalg.lstsq(terms, angles[near, 3], rcond=None)[0][-1]
    assert step == pytest.approx(3.0, abs=0.3)
    jumps = np.abs(np.diff(angles[:, 1])) > 15.0
    # One answer is off: both edges, or none where a busy machine lost that very sample.
    begins = session.events[GOING_ON[2], 'begins']
    lost = np.diff(stamps)[np.abs(stamps[:-1] - begins) < 0.1].max() > 1.5 / RATE
    assert jumps.sum() == 2 or (lost and jumps.sum() == 0)
    assert np.diff(during(GOING_ON[3], 2)).std() == pytest.approx(2.0 ** 0.5, rel=0.3)
    assert np.ptp(during(GOING_ON[4], 0)) == 0.0
    assert np.ptp(during(GOING_ON[4], 1)) > 0.0


def test_the_stamps_are_syncs_times_and_never_repeat(session):
    stamps = session.stamps()
    assert (np.diff(stamps) > 0.0).all()
    arrivals = np.array([arrived for arrived, _ in session.samples]) * 1e-9
    assert (arrivals > stamps).all()
    steps = np.diff(stamps) * RATE
    # On the producer's grid: whole periods, whatever was lost between.
    off = np.abs(steps - steps.round())
    assert np.percentile(off, 50) < 0.1


def test_the_driver_ends_well(session):
    assert session.code == 0
    entry = session.health[-1][1].status[0]
    keys = {value.key for value in entry.values}
    assert {'sets', 'SYNC sent', 'SYNC deadlines missed', 'joint_1a frame rate (Hz)',
            'joint_3a age (ms)', 'joint_1b missed cycles', 'joint_1c EMCY', 'joint_1c node 3',
            'joint_1c rejected: rolling counter unchanged', 'skew p50 / p99 / max (us)',
            'SYNC jitter p50 / p99 / max (us)', 'set rate (Hz)'} <= keys


@pytest.fixture
def watch():
    """Make watches; closed at the test's end."""
    made = []

    def make(parameters, **environment):
        made.append(Watch(parameters, **environment))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_encoders_that_lose_power_come_back_by_themselves(watch, start, bus_channel):
    """An empty bus at first, encoders, their power cut, and again."""
    driver = watch(bus_parameters(bus_channel))
    spin = driver.observer.spin_until
    assert spin(lambda: 'all encoders silent' in driver.message(), PATIENCE)
    assert driver.samples == []
    for _ in range(2):
        encoders = start('sim_bus', *parameter_arguments(bus_parameters(bus_channel)))
        before = len(driver.samples)
        assert spin(lambda n=before: len(driver.samples) > n + 100, PATIENCE)
        encoders.stop(signal.SIGKILL)
        driver.observer.spin(0.2)
        before = len(driver.samples)
        driver.observer.spin(0.5)
        assert len(driver.samples) == before
        assert 'all encoders silent' in driver.message()


class SocketcandServer:
    """
    A CAN interface that can be unplugged: python-can's socketcand protocol over TCP.

    Behind it are simulated encoders that the driver starts and synchronises.
    """

    def __init__(self, port=0):
        motion = make_motion(values('sim'))
        self._encoders = SimulatedBus(LAYOUTS, (1, 2, 3, 4), motion, (), 0.1, 1)
        self._server = socket.create_server(('127.0.0.1', port))
        self.port = self._server.getsockname()[1]
        self._link = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        try:
            self._link, _ = self._server.accept()
            self._link.sendall(b'< hi >')
            for _ in ('open', 'rawmode'):
                self._link.recv(100)
                self._link.sendall(b'< ok >')
            self._encoders.boot()
            buffer = ''
            while True:
                buffer += self._link.recv(1000).decode()
                *commands, buffer = buffer.split('>')
                for command in commands:
                    self._answer(command.split()[2:])
        except OSError:
            pass  # unplugged

    def _answer(self, words):
        identifier, data = int(words[0], 16), bytes(int(word, 16) for word in words[2:])
        now = time.monotonic()
        answers = self._encoders.cycle(now) if identifier == 0x80 \
            else self._encoders.receive(canopen.frame(identifier, data))
        for message in [*answers, *self._encoders.tend(now)]:
            self._link.sendall(f'< frame {message.arbitration_id:03X} {time.time():.6f} '
                               f'{message.data.hex()} >'.encode())

    def unplug(self):
        """Take the interface away at once."""
        ends = [end for end in (self._link, self._server) if end is not None]
        for end in ends:
            # A reset, as when the device has gone; and what waits in the thread wakes.
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b'\1\0\0\0\0\0\0\0')
            with contextlib.suppress(OSError):  # the other end was first
                end.shutdown(socket.SHUT_RD)
        self._thread.join(5.0)
        for end in ends:
            end.close()


@pytest.fixture
def plug():
    """Plug interfaces in; they are taken away after the driver has ended."""
    made = []

    def plug(port=0):
        made.append(SocketcandServer(port))
        return made[-1]

    yield plug
    made[-1].unplug()


def test_an_interface_that_disappears_is_opened_again(plug, watch):
    interface = plug()
    driver = watch({'can.interface': 'socketcand', 'can.channel': 'can0', 'rate': 100.0,
                    'can.timeout': 0.05},
                   CAN_CONFIG=f'{{"host": "127.0.0.1", "port": {interface.port}}}')
    spin = driver.observer.spin_until
    assert spin(lambda: len(driver.samples) > 50, PATIENCE), driver.driver.stderr
    interface.unplug()
    assert spin(lambda: driver.message().startswith('socketcand can0: '), 10.0), driver.message()
    assert '\n' not in driver.message()
    before = len(driver.samples)
    driver.observer.spin(0.5)
    assert len(driver.samples) == before
    plug(interface.port)
    assert spin(lambda: len(driver.samples) > before + 50, PATIENCE), driver.message()
    assert spin(lambda: driver.message() == 'publishing [can: socketcand can0]', 10.0), \
        driver.message()


@pytest.mark.parametrize(('parameters', 'words'), [
    ({'can.bitrate': 250000, 'rate': 1000.0},
     ["'rate' is 1000.0", '435 bits x 1000 Hz / 250000 bit/s = 174 %']),
    ({'can.protocol': 'j1939'}, ["'can.protocol'", 'canopen, raw']),
    ({'can.interface': 'nonsense'}, ["'can.interface' is 'nonsense'", 'socketcan']),
])
def test_a_wrong_parameter_ends_the_process(start, parameters, words):
    driver = start('encoder_driver', parameters={
        'source': 'can', **simulated_rig(), **parameters})
    assert driver.wait(PATIENCE) == 1
    assert all(word in driver.stderr for word in words)
    assert driver.stderr.count('\n') == 1
