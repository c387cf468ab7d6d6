# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A real driver on a simulated bus, whose slide is silent for two seconds."""

import threading

import can
from diagnostic_msgs.msg import DiagnosticArray
from disturbance import BESIDE_OTHERS, Disturbance
from geometry_msgs.msg import PoseStamped, QuaternionStamped
from harness import SIMULATED, stamp
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import matrix_from_quaternion

pytestmark = pytest.mark.process

# Rate of the bus, Hz; the slide's first silence and its length, s; a machine's patience, s.
RATE = 200.0
SILENT_AT = 4.0
SILENT_FOR = 2.0
PATIENCE = 60.0
PERIOD = 1.0 / RATE
# Time within which a lost insertion ends what rests on it, s.
LIMIT = 3.0 * PERIOD + 0.01
# Share of the sets of the bus that a busy machine samples, too: enough to judge by.
ENOUGH = 0.1
# Fastest motion of the simulated slide between two samples, m.
STEP = 2.5e-4
SLIDE_ID = 0x186


class Listener:
    """The times at which frames of the slide came on the bus, s."""

    def __init__(self, channel):
        self._bus = can.Bus(interface='udp_multicast', channel=channel)
        self._end = threading.Event()
        self.times = []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while not self._end.is_set():
            message = self._bus.recv(0.05)
            if message is not None and message.arbitration_id == SLIDE_ID:
                self.times.append(message.timestamp)

    def close(self):
        self._end.set()
        self._thread.join()
        self._bus.shutdown()


def seconds(collected):
    """Return the stamps of messages, s."""
    return np.array([stamp(message) for _, message in collected]) * 1e-9


def shaft(pose):
    """Return the handle's axis z in the base frame."""
    q = pose.orientation
    return matrix_from_quaternion(np.array([q.x, q.y, q.z, q.w]))[:, 2]


class Session:
    """What a master publishes of a slide that answers, is silent, and answers again."""

    def __init__(self, observer):
        self.joints = observer.collect(JointState, 'measured_js')
        self.slide = observer.collect(JointState, 'insertion/measured_js')
        self.orientations = observer.collect(QuaternionStamped, 'orientation')
        self.poses = observer.collect(PoseStamped, 'measured_cp')
        self.entries = observer.collect(DiagnosticArray, '/diagnostics')

    def is_over(self):
        """Return whether the slide was silent, and has answered again for 3 s."""
        if len(self.slide) < 10:
            return False
        lost, again = self.silence()
        return again - lost > 0.5 * SILENT_FOR and seconds(self.slide)[-1] - again > 3.0

    def silence(self):
        """Return the times of the readings before and after the longest silence, s."""
        read_at = seconds(self.slide)
        last = int(np.argmax(np.diff(read_at)))
        return read_at[last], read_at[last + 1]

    def share_with(self, others, begin, end):
        """Return the share of the sets between two times that have another message, too."""
        sampled = seconds(self.joints)
        sampled = sampled[(sampled > begin) & (sampled <= end)]
        assert len(sampled) > ENOUGH * RATE * (end - begin)
        return np.isin(sampled, seconds(others)).mean()

    def off_the_shaft(self, begin, end):
        """Return how far positions between two times are from insertion times axis, m."""
        posed_at = seconds(self.poses)
        read_at = seconds(self.slide)
        found = []
        for place in np.flatnonzero((posed_at > begin) & (posed_at <= end)):
            pose = self.poses[place][1].pose
            nearest = int(np.argmin(np.abs(read_at - posed_at[place])))
            insertion = self.slide[nearest][1].position[0]
            position = np.array([pose.position.x, pose.position.y, pose.position.z])
            found.append(np.linalg.norm(position - insertion * shaft(pose)))
        return found

    def messages(self):
        """Return levels and messages of the slide's entry on /diagnostics."""
        return {
            (entry.level, entry.message)
            for _, array in self.entries
            for entry in array.status
            if entry.name == 'encoder_driver: insertion'
        }


def test_a_lost_insertion_ends_alone_and_the_orientation_goes_on(
    start, stack, observer, bus_channel
):
    session = Session(observer)
    listener = Listener(bus_channel)
    stack.callback(listener.close)
    bus = {
        'can.interface': 'udp_multicast',
        'can.channel': bus_channel,
        'rate': RATE,
    }
    bus |= {'insertion.id': SLIDE_ID, 'insertion.node_id': 6}
    fault = f'dropout:insertion@{SILENT_AT:g}+{SILENT_FOR:g}'
    with Disturbance(BESIDE_OTHERS) as machine:
        start('sim_bus', '--sync', '--fault', fault, *SIMULATED, parameters=bus)
        driver = {'source': 'can', 'crtk_rate': RATE, **bus}
        master = start('master', *SIMULATED, parameters=driver)
        machine_was_fast = observer.spin_until(session.is_over, PATIENCE)
    machine.expect(machine_was_fast, (len(session.slide), len(session.joints), master.stderr))
    lost, again = session.silence()

    # The topic of the slide has each set until the encoder's last frame, and nothing after it.
    share = session.share_with(session.slide, lost - 1.0, lost)
    machine.expect(share == 1.0, share)
    frames = np.array(listener.times)
    last_frame = frames[np.argmax(np.diff(frames))]
    assert again - lost > 0.9 * SILENT_FOR
    assert (np.diff(seconds(session.slide)) > 0.0).all()
    published = [at for at, message in session.slide if stamp(message) * 1e-9 <= lost]
    last_message = max(published) * 1e-9
    machine.expect(last_message - last_frame < LIMIT, last_message - last_frame)
    assert any(level == b'\x02' and 'missing (' in text for level, text in session.messages())

    # The orientation has each set while the slide is silent, too.
    share = session.share_with(session.orientations, lost - 1.0, lost + 1.0)
    machine.expect(share == 1.0, share)

    # A pose has the position of the slide, and there is none while that is not known.
    posed_at = seconds(session.poses)
    assert not np.any((posed_at > lost + LIMIT) & (posed_at < again))
    for begin, end in ((lost - 1.0, lost), (again + LIMIT, again + 1.0)):
        distances = session.off_the_shaft(begin, end)
        assert len(distances) > ENOUGH * RATE * (end - begin)
        assert max(distances) < 5.0 * STEP
    assert master.stop() == 0
