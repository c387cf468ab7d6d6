# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Six encoders on a bus between processes, three of them faulty in turn: orientations go on."""

from geometry_msgs.msg import QuaternionStamped
from harness import Observer, start_program
import numpy as np
import pytest
from recording import stamps
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import parameter_arguments
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

pytestmark = pytest.mark.process

# Rate of SYNC (Hz), slow enough for a busy machine, and the window of an answer (s).
RATE, WINDOW = 250.0, 0.004
# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
UNPLUGGED, STUCK, NOISY = 'unplug:joint_3b@4+3', 'stuck:joint_1b@10+3', 'noise:joint_1c@16+3=2'
FAULTS = {UNPLUGGED: 'degraded: joint_3b missing', STUCK: 'degraded: joint_1b excluded',
          NOISY: 'degraded: joint_1c excluded'}
END = 22.0
# Longest pause that a change may cost (s).
PAUSE = 0.02
MISSING = ALL_JOINT_NAMES.index('joint_3b')


class Session:
    """
    What was published, and when each fault began and ended.

    Attributes
    ----------
    sampled, oriented : ndarray
        Stamps of the samples and of the orientations, s.
    angles : ndarray
        Joint angles of the samples, rad.
    states : list of (float, str)
        Times of arrival, s, and words of `state`.
    crtk : list of JointState
        Messages on `crtk/measured_js`.
    events : dict
        Time of each fault's beginning and end, s.

    """

    def __init__(self, channel, rate=RATE, window=WINDOW):
        observer = Observer()
        samples, crtk, orientations = (observer.collect(kind, topic) for kind, topic in (
            (JointState, 'measured_js'), (JointState, 'crtk/measured_js'),
            (QuaternionStamped, 'orientation')))
        states = observer.collect(String, 'state', STATE)
        bus = {'can.interface': 'udp_multicast', 'can.channel': channel, 'rate': rate,
               'sensors': 6, 'encoders.window': window}
        # A pause of a busy machine is no silence.
        programs = [
            start_program('fkm', parameters={
                'rate': rate, 'sensors': 6, 'sample_timeout': 2.0, 'max_age': 2.0,
                'crtk_rate': 50.0}),
            start_program('encoder_driver', parameters={
                'source': 'can', 'can.sync': 'produce', 'can.timeout': 1.0, **simulated_rig(6),
                **bus})]
        try:
            assert observer.spin_until(
                lambda: states and observer.node.count_publishers('measured_js'), PATIENCE)
            encoders = start_program('sim_bus', *parameter_arguments(
                bus | {'sim.trajectory': 'sweep'}), *(
                    word for fault in FAULTS for word in ('--fault', fault)))
            programs.append(encoders)
            assert observer.spin_until(lambda: samples, PATIENCE), encoders.stderr
            observer.spin(END)
        finally:
            self.codes = [program.stop() for program in reversed(programs)]
            observer.close()
        self.sampled, self.oriented = stamps(samples) * 1e-9, stamps(orientations) * 1e-9
        self.angles = np.array([message.position for _, message in samples])
        self.states = [(arrived * 1e-9, message.data) for arrived, message in states]
        self.crtk = [message for _, message in crtk]
        self.events = {}
        for line in encoders.stdout.splitlines():
            if line.endswith((' begins', ' ends')):
                when, text, what = line.split()
                self.events[text, what] = float(when)

    def pauses(self, fault, what):
        """
        Return what a change costs: pauses of samples and of orientations, s, and samples withheld.

        The longest ones within half a second before and two seconds after it; then the samples
        that lack a joint without a fault, which a busy machine has lost.
        """
        at = self.events[fault, what]
        sampled, oriented = (times[(times > at - 0.5) & (times < at + 2.0)]
                             for times in (self.sampled, self.oriented))
        others = [index for index, name in enumerate(ALL_JOINT_NAMES) if name not in fault]
        lost = np.isnan(self.angles[np.isin(self.sampled, sampled)][:, others]).any(axis=1)
        withheld = ~np.isin(sampled, oriented)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], withheld, [0]])))
        return (np.diff(sampled).max(), np.diff(oriented).max(),
                max(edges[1::2] - edges[::2], default=0), int(lost.sum()))


@pytest.fixture(scope='module')
def session(bus_channel):
    return Session(bus_channel)


def during(session, fault):
    """Return which samples are of the time of a fault, without its beginning and end."""
    return (session.sampled > session.events[fault, 'begins'] + 0.5) \
        & (session.sampled < session.events[fault, 'ends'] - 0.2)


@pytest.mark.parametrize('what', ['begins', 'ends'])
@pytest.mark.parametrize('fault', FAULTS)
def test_a_change_costs_a_short_pause(session, fault, what):
    """Beyond the pauses that the machine makes in the samples themselves."""
    of_samples, of_orientations, withheld, lost = session.pauses(fault, what)
    print(f'{fault} {what}: longest pause of the samples {1e3 * of_samples:.1f} ms, of the '
          f'orientations {1e3 * of_orientations:.1f} ms, {withheld} samples withheld in a row, '
          f'{lost} lack another joint')
    if lost and withheld / RATE > PAUSE:
        pytest.skip(f'a busy machine lost readings of other joints in {lost} samples')
    assert withheld / RATE <= PAUSE


def test_each_fault_has_its_state_and_each_end_is_healthy(session):
    found = [text for _, text in session.states]
    assert found[0] == 'starting' and found[-1] == 'healthy'
    for fault, text in FAULTS.items():
        begins, ends = (session.events[fault, what] for what in ('begins', 'ends'))
        assert any(begins < time < ends and state == text for time, state in session.states)
        assert any(time > ends and state == 'healthy' for time, state in session.states)
    assert session.codes[1:] == [0, 0]


def test_a_joint_without_a_reading_is_nan_on_both_topics(session):
    """And on no other topic: each sample of the time has its orientation."""
    gone = during(session, UNPLUGGED)
    assert gone.sum() > RATE
    assert np.isnan(session.angles[gone, MISSING]).all()
    assert np.isfinite(session.angles[gone]).sum(axis=1).min() >= 4
    copies = [message for message in session.crtk
              if min(abs(session.sampled[gone] - _seconds(message))) < 1e-6]
    assert len(copies) > 20
    assert all(message.name == list(ALL_JOINT_NAMES) for message in copies)
    assert np.isnan([message.position[MISSING] for message in copies]).all()
    assert np.isin(session.sampled[gone], session.oriented).mean() > 0.99


def _seconds(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
