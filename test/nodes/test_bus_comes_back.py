# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Encoders and an interface that go away and come back: the driver goes on by itself."""

import contextlib
import signal
import socket
import threading
import time

from driver_watch import bus_parameters, Watch
from encoder_frames import LAYOUTS, values
import pytest
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0


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
        # On a busy machine it is named once it has lasted.
        assert spin(lambda: 'all encoders silent' in driver.message(), PATIENCE)


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
    # Whether the reading or the sending thread meets it first.
    assert spin(lambda: driver.message().startswith((
        'socketcand can0: ', 'no frames on socketcand can0 (sending: ')), 10.0), driver.message()
    assert '\n' not in driver.message()
    before = len(driver.samples)
    driver.observer.spin(0.5)
    assert len(driver.samples) == before
    plug(interface.port)
    assert spin(lambda: len(driver.samples) > before + 50, PATIENCE), driver.message()
    assert spin(lambda: driver.message() == 'publishing [can: socketcand can0]', 10.0), \
        driver.message()
