# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What fkm publishes, and when it keeps silent and says why."""

from pathlib import Path
import sys

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from fkm_rig import angles, CLEAR, fkm_rig, POSE
from harness import stamp
from in_process import hosted
import numpy as np
import pytest
from rclpy.parameter import Parameter
from spm_haptic_master.kinematics import matrix_from_zxz
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.ros.overload import START, TOO_BUSY
from spm_haptic_master.supervision import supervise

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'supervision'))

from device import encoders, joint_angles, motion  # noqa: E402, I100

NAMES = list(JOINT_NAMES)
# A device that rests is not checked by its motion: its faults are cleared all the same.
RESTING = 'recovery:=0.2', 'alert_limit_deg:=5.0'


@pytest.fixture
def rig():
    with fkm_rig('frame_id:=base_of_the_test', *RESTING) as rig:
        yield rig


@pytest.mark.parametrize(
    ('position', 'names', 'reason'),
    [
        (angles()[:3], NAMES[:3], 'misnamed'),
        (angles()[:3], NAMES, 'incomplete'),
        ([*angles(), 0.0], NAMES, 'incomplete'),
        ([], NAMES, 'incomplete'),
        (angles(POSE, 6), ALL_JOINT_NAMES, 'silent: sample of another number of sensors'),
        ([*angles()[:3], float('nan')], NAMES, 'not finite'),
        ([float('inf'), float('-inf'), *angles()[2:]], NAMES, 'not finite'),
        (angles(), [NAMES[0], NAMES[2], NAMES[1], NAMES[3]], 'misnamed'),
        (angles(), [], 'misnamed'),
    ],
)
def test_a_bad_sample_gives_silence_and_a_reason(rig, position, names, reason):
    rig.qualify()
    assert rig.send_many(10, position, names=names) == []
    rig.host.run(0.02)
    assert reason in rig.host.entry('orientation').message + str(
        rig.host.figures('orientation').get('last rejected')
    )
    assert rig.host.entry('orientation').level == DiagnosticStatus.ERROR
    # And it does not spoil what follows.
    rig.qualify()


@pytest.mark.parametrize('joint', ['joint_1b', 'joint_3a'])
def test_a_jump_at_rest_is_a_fault_until_motion_has_checked_the_sensors(rig, joint):
    rig.qualify()
    jumped = np.add(angles(), np.radians(2.0) * np.equal(NAMES, joint))
    assert rig.send_many(10, list(jumped)) == []
    rig.host.run(0.02)
    assert rig.host.entry('orientation').level == DiagnosticStatus.ERROR
    # Back where it was, three of the four can still not tell which of them it was.
    assert rig.send_many(300, angles()) == []
    assert 'waits until checked: joint_1c' in rig.state
    assert 'tilt the handle towards the centre' in rig.state
    # As the state asks for: towards the centre, and away from the singularity.
    way = np.linspace(0.0, 1.0, 200)
    poses = matrix_from_zxz(
        np.radians(130.0 + 5.0 * way),
        np.radians(50.0 + 5.0 * way),
        np.radians(30.0 - 25.0 * way),
    )
    rig.send_many(len(poses), *map(angles, poses))
    rig.qualify(angles(poses[-1]))


def test_another_rigs_calibration_is_suspected_where_no_orientation_fits():
    with fkm_rig() as rig:
        rig.send_many(20, [3.0, -3.0, 3.0, 0.0])
        assert rig.host.entry('orientation').message == (
            "silent: no orientation fits: the calibration may be another rig's, or no longer "
            'hold: calibrate --motion --check calibration.yaml'
        )


def test_old_future_and_repeated_samples_give_silence(rig):
    rig.qualify()
    for offset, reason in ((-3.0, 'stale'), (3.0, 'future')):
        assert rig.send_many(10, angles(), offset=offset) == []
        assert reason in rig.reason
        rig.qualify()
    (orientation,) = rig.send(angles())
    again = -1e-9 * (rig.host.time_ns() - stamp(orientation))
    for _ in range(10):
        assert rig.send(angles(), offset=again) == []
        again -= 0.005
    assert 'not newer' in rig.reason


def test_silence_of_the_driver_is_reported_and_ends(rig):
    rig.qualify()
    rig.host.run(0.3)
    assert rig.state == rig.host.entry('orientation').message == 'silent: no joint samples'
    rig.qualify()
    rig.host.run(0.04)
    assert rig.state == 'healthy'


def test_simulated_time_that_stands_still_is_silence_with_a_reason():
    with fkm_rig('use_sim_time:=true') as rig:
        assert rig.send_many(20, angles()) == []
        assert rig.state == 'silent: sample from the future'


def test_the_quaternion_never_jumps_to_its_opposite(rig):
    def at(turn):
        return angles(matrix_from_zxz(*np.radians([135.0, 54.7356, turn])))

    rig.qualify(at(20.0))
    got = rig.send_many(0, *map(at, np.linspace(20.0, 60.0, 100)))
    assert len(got) == 100
    q = np.array([[m.quaternion.x, m.quaternion.y, m.quaternion.z, m.quaternion.w] for m in got])
    assert np.all(np.sum(q[1:] * q[:-1], axis=1) > 0.99)
    # w crosses zero on the way (psi + phi = 180 deg), where a sign by w >= 0 would jump.
    assert np.ptp(np.sign(q[:, 3])) == 2.0


def noisy(rng, position=CLEAR):
    return np.add(position, np.radians(0.02) * rng.normal(size=len(position)))


def test_the_alert_limit_is_live():
    rng = np.random.default_rng(4)
    with fkm_rig('recovery:=0.2') as rig:
        above = 'silent: protection level above the alert limit'
        for limit, state in ((1.0, 'healthy'), (0.1, above), (1.0, 'healthy')):
            assert rig.host.node.set_parameters_atomically(
                [Parameter('alert_limit_deg', value=limit)]
            ).successful
            rig.send_many(0, *(noisy(rng) for _ in range(200)))
            assert rig.state == state
            assert bool(rig.send(CLEAR)) == (state == 'healthy')


def test_two_sensors_that_jump_wait_for_the_acknowledgement():
    rng = np.random.default_rng(4)
    with fkm_rig('recovery:=0.2') as rig:

        def send(count, offset_deg=(0.0, 0.0, 0.0, 0.0)):
            return rig.send_many(
                0, *(noisy(rng, CLEAR + np.radians(offset_deg)) for _ in range(count))
            )

        assert send(200)
        assert 'no fault waits' in rig.host.call('~/acknowledge').message
        # They stay: an interference of some milliseconds would clear by itself.
        assert send(100, (25.0, -20.0, 0.0, 0.0)) == []
        # Right again, and consistent for longer than the recovery: not by itself.
        assert send(200) == []
        assert rig.state.endswith('to be acknowledged')
        answer = rig.host.call('~/acknowledge')
        assert answer.success
        assert 'joint_1a and joint_1b jumped' in answer.message
        # At rest two of the sensors cannot be checked: a person ends that wait, too.
        assert send(200) == []
        assert 'waits until checked: joint_1c and joint_3a' in rig.state
        assert rig.host.call('~/acknowledge').success
        send(200)
        assert rig.state == 'healthy'


def test_a_drift_of_the_calibration_is_a_warning_while_orientations_go_on():
    """A zero that slipped by less than a fault."""
    slip = np.radians([0.0, 0.18, 0.0, 0.0])
    samples = joint_angles(motion('sweep', 120.0, 10.0), 4) + slip
    with hosted(
        Fkm,
        'rate:=10.0',
        'bias_deg:=[0.07, 0.07, 0.07, 0.07]',
        'window:=0.5',
        'sample_timeout:=0.3',
    ) as host:
        for row in samples.tolist():
            host.node.take(host.time_ns(), tuple(row))
            host.run(0.1)
        found = host.entry('orientation')
        values = host.figures('orientation')
        assert found.level == DiagnosticStatus.WARN
        assert 'calibration: joint_1b' in found.message
        assert found.message.endswith(' since')
        assert abs(float(values['joint_1b drift (deg)'])) > 0.1
        assert float(values['calibration: slow parity (deg)']) > 0.03
        assert len(host.sent['orientation']) > 0.95 * len(samples)


def test_samples_that_show_nothing_of_the_calibration_are_counted():
    """Each second: of a joint without a reading, though the orientation goes on."""
    with fkm_rig('sensors:=6', *RESTING) as rig:
        sample = angles(POSE, 6)
        rig.send_many(200, sample)
        assert rig.send_many(405, [*sample[:4], float('nan'), sample[5]])
        rig.host.run(1.0)
        assert rig.host.figures('orientation')['calibration: samples not accepted'] == '2'


def test_fkm_is_silent_with_a_driver_of_another_mechanism():
    with fkm_rig() as rig:

        def report(mechanism):
            rig.host.give(
                '/diagnostics',
                DiagnosticArray(
                    status=[
                        DiagnosticStatus(
                            name='encoder_driver: encoders',
                            values=[KeyValue(key='mechanism', value=mechanism)],
                        )
                    ]
                ),
            )
            # It is looked at now and then.
            rig.send_many(50, CLEAR)

        rig.host.publishers['/measured_js'] = ('encoder_driver',)
        report('of another rig')
        assert rig.state == 'silent: another mechanism in the driver'
        assert rig.send(CLEAR) == []
        assert 'encoder_driver has of another rig' in rig.reason
        assert 'for all nodes, /**' in rig.host.figures('orientation')['last rejected']
        report(rig.host.figures('orientation')['mechanism'])
        rig.send_many(50, CLEAR)
        assert rig.state == 'healthy'
        assert rig.send(CLEAR)


def test_a_process_that_did_not_run_blames_the_machine_and_not_the_sensors(rig):
    rig.host.run(2.0 * START)
    rig.qualify()
    rig.host.pause(1.5)
    rig.send_many(100, angles())
    rig.host.run(1.0)
    said = [entry.message for array in rig.sent['/diagnostics'] for entry in array.status]
    assert any(TOO_BUSY in message for message in said)
    assert not any(
        words in message for message in said for words in ('stale', 'clocks', 'too fast', 'jumped')
    )


def test_a_busy_machine_explains_silence_and_nothing_else(rig):
    rig.host.run(2.0 * START)
    rig.qualify()
    rig.host.node.driver_overload = lambda: TOO_BUSY
    rig.send_many(20, angles())
    assert rig.state == 'healthy'
    assert rig.send(angles())
    rig.host.run(0.3)
    assert rig.state == f'silent: {TOO_BUSY}'
    rig.send_many(20, angles())
    rig.host.publishers['/orientation'] = 'fkm', 'other'
    rig.send_many(60, angles())
    assert rig.state.startswith('silent: 2 publishers on /orientation: /fkm, /other')


# The states that are published are those of `supervise`
# Samples of a run, their period (ns), the first of a fault, and the last of one that ends.
COUNT = 1000
PERIOD = 2_000_000
BEGIN = 300
END = 500
SETTINGS = {'recovery': 0.3, 'rate': 500.0}


def added(part, degrees):
    """Add degrees to a part of the angles."""
    part += np.radians(degrees)


# What changes angles and times of healthy sensors.
EVENTS = {
    'healthy': lambda angles, times: None,
    'fault': lambda angles, times: added(angles[BEGIN:END, 1], 5.0),
    'missing and return': lambda angles, times: added(angles[BEGIN:END, -1], np.nan),
    'lost samples': lambda angles, times: added(angles[BEGIN : BEGIN + 50], np.nan),
    'clock set back': lambda angles, times: np.subtract(
        times[BEGIN:], 2_000_000_000, out=times[BEGIN:]
    ),
}


@pytest.mark.parametrize(
    ('event', 'sensors'),
    [
        ('fault', 4),
        ('clock set back', 4),
        ('missing and return', 6),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (('healthy', 4), ('fault', 6), ('lost samples', 6))
        ),
    ],
)
def test_fkm_publishes_the_states_of_supervise(event, sensors):
    times = np.arange(COUNT, dtype=np.int64) * PERIOD
    samples = encoders(
        joint_angles(motion('turning', COUNT * PERIOD * 1e-9, 1e9 / PERIOD), sensors)
    )
    EVENTS[event](samples, times)
    expected = [
        text
        for _, text in supervise(
            times + 10_000_000_000, samples, sensors=sensors, **SETTINGS
        ).state
    ]
    assert expected[0] == 'starting'
    assert (expected == ['starting', 'healthy']) is (event == 'healthy')
    with hosted(
        Fkm,
        f'sensors:={sensors}',
        'max_age:=10.0',
        'sample_timeout:=10.0',
        *(f'{name}:={value}' for name, value in SETTINGS.items()),
    ) as host:
        times += host.time_ns()
        for when, row in zip(times.tolist(), samples.tolist(), strict=True):
            host.node.take(when, tuple(row))
            host.run(1e-9 * PERIOD)
        host.run(0.02)
        assert [message.data for message in host.sent['state']] == expected
