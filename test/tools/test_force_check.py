# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""force_check on a recorded bring-up: MuJoCo's device, a known weight, encoders with noise."""

from collections import Counter
import csv

from benchmarks.pipeline.child_process import wait_until
from harness import SIMULATED
import numpy as np
import pytest
from spm_haptic_master.calibration.motor_bring_up import identify_friction
from spm_haptic_master.drives.drives import DriveReport
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.exceptions import CalibrationError, InputError
from spm_haptic_master.force import ForceLimits, Gravity, render
from spm_haptic_master.force.gravity import Weight
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    workspace_pose,
)
from spm_haptic_master.tools import force_check, force_record

PATIENCE = 120.0
HEADER = ['part', 'time', *force_record.ANGLES, *force_record.TORQUES[:3]]
WEIGHT = Gravity(handle=(0.001, -0.0005, 0.006), proximal=(0.002, 0.0, 0.001, 0.001, 0.0, 0.002))
STATICS = make_statics(Geometry(), (1, 1, 1), 3, ForceLimits())


def holding(R):
    """Return the motor torques that hold the weight, N m."""
    STATICS.place(tuple(np.ravel(R).tolist()))
    return render(R, Weight(WEIGHT, STATICS).torque()).motor_torque


def poses(noise):
    """Return the rows of twelve poses, with noise of the torques, N m."""
    rng = np.random.default_rng(1)
    rows = []
    for number in range(12):
        R = workspace_pose(
            rng.uniform(0.05, 0.3),
            rng.uniform(0.0, 6.2),
            rng.uniform(0.0, 0.5),
        )
        joints = inverse(R)
        error = noise * rng.normal(size=3)
        for step in range(20):
            angles = (*joints.theta1, joints.theta3a) + np.radians(0.04) * rng.normal(size=4)
            rows.append([f'pose {number}', 1e-3 * step, *angles, *(holding(R) + error)])
    return rows


def written(
    path,
    rows,
    header=HEADER,
):
    with path.open('w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return str(path)


def weight_of(text):
    """Return the weight of the handle that force_check has printed, kg m."""
    return [float(value) for value in text.split('handle [')[1].split(']')[0].split(',')]


@pytest.fixture
def check(tmp_path, capsys):
    """Return a function that runs force_check on rows or on a file: exit code, output, errors."""

    def run(rows, *args):
        if isinstance(rows, str):
            path = rows
        else:
            path = written(tmp_path / 'a.csv', rows)
        capsys.readouterr()
        return force_check.main(['force_check', path, *args]), *capsys.readouterr()

    return run


@pytest.mark.parametrize(('noise', 'fails'), [(5e-4, False), (2e-2, True)])
def test_the_weight_explains_the_torques_that_hold_the_poses(
    check,
    noise,
    fails,
):
    code, text, _ = check(poses(noise), '--poses', '0')
    assert ('the weight does not explain' in text) is fails
    assert code == fails
    if not fails:
        assert weight_of(text) == pytest.approx(WEIGHT.handle, abs=5e-4)


@pytest.mark.parametrize(
    ('rows', 'words'),
    [
        ([['hold', '0', *['0'] * 7]], "part 'hold'"),
        ([['step 9x', '0', *['0'] * 7]], 'step 9x'),
        ([['step 3a', '0', *['0'] * 7]], "part 'step 3a'"),
        ([['step 1a-b', '0', *['0'] * 7]], '1a-b'),
        ([['pose 1', '0', *['x'] * 7]], 'cannot be read'),
        ([], 'torques of 0 motors'),
        ([['pose 1', '0', *['nan'] * 7]], "part 'pose 1': expected finite numbers"),
        (
            [['release z 1', '0', *['0'] * 7]],
            "part 'release z 1': no orientation has these angles",
        ),
        ([['step 1a', '0', *['0'] * 7]], 'a step has 1 samples: expected 10 or more'),
    ],
)
def test_a_file_that_is_no_recording(
    check,
    rows,
    words,
):
    code, _, text = check(rows)
    assert code == 1
    assert words in text


def test_a_file_that_is_no_text_is_one_short_line(check, tmp_path):
    path = tmp_path / 'bring_up.csv'
    path.write_bytes(b'\xff' * 9999)
    code, _, text = check(str(path))
    assert code == 1
    assert "UnicodeDecodeError: 'utf-8' codec can't decode byte 0xff in position 0" in text
    assert len(text) < 500


def test_a_file_that_does_not_exist(check, tmp_path):
    assert check(str(tmp_path / 'none.csv'))[0] == 1


def test_friction_by_the_formula():
    """Two speeds of a body with known inertia, viscous and dry friction."""
    inertia = 4e-4
    viscous = 1.1e-3
    dry = 2e-3
    dt = 1e-4
    releases = []
    for push in (0.01, -0.02):
        time = 0.0
        angle = 0.0
        speed = 0.0
        rows = []
        for step in range(1500):
            torque = push * (100 <= step < 600)
            rows.append((time, angle, torque))
            friction = viscous * speed + dry * np.sign(speed)
            speed += dt * (torque - friction) / inertia
            angle += dt * speed
            time += dt
        releases.append(tuple(np.array(rows).T))
    found = identify_friction(releases)
    assert found.inertia == pytest.approx(inertia, rel=0.03)
    assert found.viscous == pytest.approx(viscous, rel=0.1)
    assert found.dry == pytest.approx(dry, rel=0.1)
    # Half of (b + B) / (T / 2 + t_d).
    assert found.stiffest(0.005, 1e-3, 1e-3) == pytest.approx(
        0.5 * (found.viscous + 0.005) / 1.5e-3
    )


class Rig:
    """Encoders and drives of MuJoCo's device: a torque is in force until the next angles."""

    fault = None
    motors = 3

    def __init__(
        self,
        wires=((0, 1.0), (1, 1.0), (2, 1.0)),
        ready_after=5,
    ):
        pytest.importorskip('mujoco', reason='needs mujoco')
        from study.force.plant import Plant

        self.plant = Plant(workspace_pose(0.05, 0.3, np.radians(10.0)))
        # Of each motor as commanded: the one that moves, and its torque over the command.
        self.wires = wires
        self.rng = np.random.default_rng(2)
        self.stamp = 0
        self.steps = 0
        self.ready_after = ready_after
        self.torques = []

    def read(self, timeout):
        self.stamp += 1_000_000
        angles = np.array(self.plant.angles) + np.radians(0.04) * self.rng.normal(size=4)
        return JointSample(self.stamp, tuple(angles.tolist()))

    def step(self, torques, now):
        self.steps += 1
        self.torques.append(torques)
        made = [0.0, 0.0, 0.0]
        for torque, (motor, factor) in zip(torques, self.wires, strict=True):
            made[motor] += factor * torque
        self.plant.run(made)
        return DriveReport(
            ready=self.steps > self.ready_after,
            fault=None,
            torques=torques,
            seconds_since_status=0.0,
        )


def recording_of(
    rig,
    path,
    show=lambda text: None,
    poses=0,
):
    bring_up = force_record.BringUp(
        rig,
        rig,
        Geometry(),
        (1, 1, 1),
        (np.radians(0.04),) * 4,
        0.1,
        show,
    )
    force_record.record(path, bring_up, poses)
    return str(path)


def number_after(words, text):
    """Return the number that comes after some words."""
    return float(text.split(words)[1].split()[0])


def test_a_device_that_is_moved_by_its_drives(tmp_path, check):
    rig = Rig()
    path = recording_of(rig, tmp_path / 'a.csv')
    assert not any(map(any, rig.torques[:5]))
    assert np.abs(rig.torques).max() <= 0.05
    code, text, _ = check(path)
    assert code == 0, text
    assert text.count('sign right') == 3
    assert 'springs of 1 N m/rad are passive' in text
    # 1.1 mN m s/rad in the model.
    assert 0.5 <= number_after('friction ', text) <= 2.0
    stiffest = []
    for args in (('--stiffness', '10'), ('--latency', '0.02')):
        code, text, _ = check(path, *args)
        assert code == 1
        assert 'N m/rad about z, at 1000 Hz' in text
        stiffest.append(number_after('largest stiffness ', text))
    # By half the period and the latency.
    assert stiffest[0] / stiffest[1] == pytest.approx(20.5 / 1.5, rel=0.05)


class Hand:
    """
    Does what it is asked for with a device of which each motor turns its own joint alone.

    The weight is there while the motors hold it in a pose: before, the handle is balanced.
    """

    fault = None
    motors = 3

    def __init__(self):
        rng = np.random.default_rng(100)
        self.rotations = iter(
            workspace_pose(
                rng.uniform(0.05, 0.3, 6),
                rng.uniform(0.0, 6.2, 6),
                rng.uniform(0.0, 0.5, 6),
            )
        )
        self.bring(workspace_pose(0.05, 0.3, 0.2))
        self.angles = self.aim
        self.stamp = 0
        self.asked = []
        self.held = []

    def bring(self, R):
        joints = inverse(R)
        self.aim = np.array([*joints.theta1, joints.theta3a])
        self.pose = R
        self.speed = np.zeros(3)
        self.weight = None

    def show(self, text):
        self.asked.append((text, self.stamp))
        if 'bring' in text:
            self.bring(next(self.rotations))
        elif 'let go of the handle' in text:
            self.weight = holding(self.pose)
            self.held.append(self.aim[:3])
        elif 'take' in text:
            self.aim = self.aim + 0.2
            self.weight = None
        elif 'pose' not in text:
            self.angles = self.aim
            self.speed = np.zeros(3)

    def read(self, timeout):
        self.stamp += 1_000_000
        return JointSample(self.stamp, tuple(self.angles.tolist()))

    def step(self, torques, now):
        if len(self.asked) > 7 and self.weight is None:
            self.angles = self.angles + np.clip(self.aim - self.angles, -5e-4, 5e-4)
        else:
            net = np.subtract(torques, 0.0 if self.weight is None else self.weight)
            self.speed = 0.99 * self.speed + 1.6 * net
            self.angles = self.angles + 1e-3 * np.append(self.speed, 0.0)
        return DriveReport(
            ready=True,
            fault=None,
            torques=torques,
            seconds_since_status=0.0,
        )


@pytest.fixture(scope='module')
def session(tmp_path_factory):
    """Record a session with a hand; return the hand, the file and its rows."""
    path = tmp_path_factory.mktemp('session') / 'a.csv'
    hand = Hand()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(force_record, 'LET_GO', 0.5)
        patch.setattr(force_record, 'QUIET', 0.5)
        recording_of(hand, path, hand.show, 6)
    with path.open() as file:
        return hand, str(path), list(csv.DictReader(file))


def numbers(rows, names):
    """Return the numbers of three columns, (rows, 3)."""
    return np.array([[float(row[name]) for name in names[:3]] for row in rows])


def test_a_session_has_its_parts_at_1_khz(session):
    """Of a step 0.1 s, of a release 0.25 s, of a pose 0.5 s."""
    _, _, rows = session
    counts = Counter(row['part'] for row in rows)
    assert counts == {
        **{f'step {motor}': 100 for motor in ('1a', '1b', '1c')},
        **{f'release z {number}': 250 for number in range(1, 5)},
        **{f'pose {number}': pytest.approx(500, abs=1) for number in range(1, 7)},
    }


def test_the_steps_of_a_session_are_of_one_motor_each(session):
    _, _, rows = session
    steps = numbers(rows[:300], force_record.TORQUES)
    assert steps.max(axis=0).tolist() == [0.01] * 3
    assert np.count_nonzero(steps) == 3 * 50


def test_in_the_poses_of_a_session_springs_hold_the_weight(session):
    """Each, of 1 N m/rad, gives way until it holds its motor's part."""
    hand, _, rows = session
    middle = slice(250, None, 500)
    angles = numbers(rows[-3000:], force_record.ANGLES)[middle]
    torques = numbers(rows[-3000:], force_record.TORQUES)[middle]
    np.testing.assert_allclose(torques, np.subtract(hand.held, angles), atol=1e-4)


def test_a_session_says_what_to_do_and_waits_until_it_is_done(session):
    hand, _, _ = session
    texts, times = zip(*hand.asked, strict=True)
    assert [text.split(': ')[1] for text in texts[8:11]] == [
        'let go of the handle',
        'at rest, recording',
        'recorded',
    ]
    assert [text.split()[0] for text in texts[7:32:4]] == ['pose'] * 6 + ['all']
    # Till it is still in the new pose, let go is at rest again, and is taken by 0.1 rad.
    still, rest, _, taken = np.diff(times[7:]).reshape(6, 4).T * 1e-9
    assert (1.2 < still).all()
    assert (0.8 < rest).all()
    assert (rest < 1.2).all()
    assert (0.15 < taken).all()


def test_one_session_shows_signs_and_weight(session, check):
    _, path, _ = session
    _, text, _ = check(path)
    assert text.count('sign right') == 3
    assert 'weight from 6 poses' in text
    assert weight_of(text) == pytest.approx(WEIGHT.handle, abs=5e-4), text
    assert 'the weight does not explain' not in text


def wired(**changed):
    """Return the wires of three motors; those that are changed by joint: motor, factor."""
    right = {'a': (0, 1.0), 'b': (1, 1.0), 'c': (2, 1.0)}
    return tuple((right | changed).values())


def test_a_handle_is_not_released_by_a_motor_that_is_turned_over(tmp_path, check):
    code, text, _ = check(recording_of(Rig(wired(c=(2, -1.0))), tmp_path / 'a.csv'))
    assert code == 1
    assert 'motor on th1C: sign wrong' in text
    assert 'friction' not in text
    assert text.count('sign right') == 2


MOTORS = {'a': 0, 'b': 1, 'c': 2}
SWAPS = ('a', 'b'), ('a', 'c'), ('b', 'c')
WRONG = [
    *(
        (wired(**{name: (motor, -1.0)}), f'motor on th1{name.upper()}: sign wrong')
        for name, motor in MOTORS.items()
    ),
    *(
        (
            wired(**{one: (MOTORS[other], advice), other: (MOTORS[one], advice)}),
            f'motor on th1{one.upper()} turns th1{other.upper()} most: are node ids or cables',
        )
        for one, other in SWAPS
        for advice in (1.0, -1.0)
    ),
    *(
        (wired(**{name: (motor, 10.0)}), 'is its rated torque right')
        for name, motor in MOTORS.items()
    ),
]


@pytest.mark.parametrize(('wires', 'words'), WRONG)
def test_a3_each_of_twelve_wrong_wirings_is_found_in_words(
    tmp_path,
    check,
    wires,
    words,
):
    """Signs, swaps with and without the advice to reverse both, rated torques ten times off."""
    path = tmp_path / 'a.csv'
    rig = Rig(wires)
    try:
        recording_of(rig, path)
    except InputError as error:
        found = str(error)
        code = 1
    else:
        code, found, _ = check(str(path))
    assert code == 1
    assert words in found
    assert 'friction' not in found
    assert ('reverse its direction' in found) is ('sign wrong' in words)


def test_drives_and_encoders_that_are_not_there(
    tmp_path,
    monkeypatch,
    check,
):
    rig = Rig(ready_after=10**9)
    monkeypatch.setattr(force_record, 'READY', 0.05)
    with pytest.raises(InputError, match='not ready after'):
        recording_of(rig, tmp_path / 'a.csv')
    assert not any(map(any, rig.torques))
    monkeypatch.setattr(rig, 'read', lambda timeout: None)
    with pytest.raises(InputError, match='no set of angles'):
        recording_of(rig, tmp_path / 'a.csv')
    code, _, text = check(str(tmp_path / 'a.csv'), '--record')
    assert code == 1
    assert "drives.channel = ''" in text


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({0: 1.0}, 'step 1a: a joint turned by 1.0'),
        ({0: np.nan}, 'expected those of all joints'),
        (None, 'no set of angles within 0.1 s'),
        ('drives', 'step 1a: the drives are no longer ready'),
    ],
)
def test_a_recording_ends_where_drives_or_angles_fail(
    tmp_path,
    change,
    words,
):
    rig = Rig()
    read = rig.read
    step = rig.step

    def failing(timeout):
        sample = read(timeout)
        if rig.steps < 300 or change == 'drives':
            return sample
        return change and JointSample(
            sample.stamp,
            tuple(angle + change.get(joint, 0.0) for joint, angle in enumerate(sample.angles)),
        )

    rig.read = failing
    if change == 'drives':
        rig.step = lambda torques, now: step(torques, now)._replace(ready=rig.steps < 300)
    with pytest.raises(InputError, match=words):
        recording_of(rig, tmp_path / 'a.csv')
    assert not (tmp_path / 'a.csv').exists()


def test_what_determines_nothing():
    still = np.linspace(0.0, 0.1, 50), np.zeros(50), np.ones(50)
    with pytest.raises(CalibrationError, match='is the handle free'):
        identify_friction([still])


@pytest.mark.process
def test_a_recording_by_drives_and_encoders_between_processes(
    start,
    bus_channel,
    tmp_path,
):
    """The simulated encoders stand still whatever the simulated drives do: no sign is seen."""
    bus = {
        'can.interface': 'udp_multicast',
        'can.channel': bus_channel,
        'rate': 200.0,
        'drives.rated_torque': [0.5],
        'drives.event_timer': 1.0,
        'drives.status_timeout': 1.0,
        'drives.heartbeat_timeout': 1.0,
    }
    devices = start(
        'sim_bus',
        '--sync',
        '--drives',
        '3',
        *SIMULATED,
        parameters={
            **bus,
            'sim.trajectory': 'fixed',
            'sim.pose_deg': [130.0, 50.0, 20.0],
        },
    )
    assert wait_until(lambda: 'four encoders' in devices.stdout, PATIENCE), devices.stderr
    path = str(tmp_path / 'recording.csv')
    check = start(
        'force_check',
        path,
        '--record',
        *SIMULATED,
        parameters={
            **bus,
            'source': 'can',
            'can.timeout': 5.0,
            'drives.interface': 'udp_multicast',
            'drives.channel': bus_channel,
        },
    )
    assert check.wait(PATIENCE) == 1
    # The drives were proven. A busy machine may leave too few samples of a step to see anything
    # in, or stop a drive.
    assert 'step 1a' in check.stderr, check.stderr
    assert 'not seen: no joint turned' in check.stdout or any(
        text in check.stderr for text in ('expected 10 or more', 'the drives are no longer ready')
    ), check.stderr
    assert 'Traceback' not in check.stderr
    assert 'sign right' not in check.stdout
