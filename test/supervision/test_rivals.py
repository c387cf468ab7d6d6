# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
No other orientation is taken for the right one: the rows of the attacks, by their names.

Each was published as healthy, and checked, once.
"""

from dataclasses import replace

from device import (
    about,
    encoders,
    every,
    joint_angles,
    MS,
    offset,
    Outcome,
    paused,
    ramp,
    run,
    SINGULAR,
    stuck,
)
import numpy as np
import pytest
from rig import few, Rig
from spm_haptic_master.kinematics import forward_all, quaternion_from_matrix, workspace_pose
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.rotations import rotation_distance

FINE = {'sigma_deg': [0.006] * 4, 'bias_deg': [0.01] * 4}


def at(phi, tilt=0.0, azimuth=0.0):
    """Return the poses of self-rotations, at a tilt in a direction, deg, (n, 3, 3)."""
    phi = np.radians(np.asarray(phi, float))
    return workspace_pose(
        0.0 * phi + np.radians(tilt),
        0.0 * phi + np.radians(azimuth),
        phi,
    )


def to_and_fro(phi, amplitude, samples, rest):
    """Return self-rotations, deg: to and fro once, then at rest."""
    swing = amplitude * np.sin(np.linspace(0.0, np.pi, samples))
    return np.concatenate([phi - swing, np.full(rest, float(phi))])


def mirror(rotation):
    """Return the offset of th3A, deg, with which all four angles fit another orientation."""
    angles = joint_angles(rotation[None])[0]
    for other in forward_all(angles[:3]):
        change = joint_angles(other[None])[0] - angles
        # NaN, out of reach, is none.
        is_same = np.abs(change[:3]).max() < 1e-6
        if is_same and abs(change[3]) > 1e-3:
            return float(np.degrees(change[3]))
    raise AssertionError('the pose has no mirror image in this working mode')


def wrong_while_checked(found, sensor, rate=1000.0):
    """Whether it is off by more than its level for longer than the time to alert, checked."""
    return found.longest_undeclared(sensor, rate) > max(0.02, 10.0 / rate)


def test_v1_a_step_onto_another_solution_is_never_the_same_solution():
    """10 deg off, at a level of 0.6, healthy for ever: it was within the 10 deg of the last."""
    phi = to_and_fro(44.4, 12.0, 250, 1000)
    found = run(
        at(phi),
        rate=250.0,
        change=offset(600, 3, mirror(at([44.4])[0])),
        noise=0.006,
        bits=17,
        **FINE,
    )
    assert not wrong_while_checked(found, 3, 250.0)
    assert found.states[-1].startswith('silent: joint_3a jumped')


@pytest.mark.parametrize('pause', few([90, 300, 450, 2000], count=2))
def test_v1_a_pause_in_which_th3a_keeps_its_value_leaves_it_unchecked(pause):
    """The handle turns from one side of the singularity to the other meanwhile."""
    phi = np.concatenate([to_and_fro(29.4, 8.0, 300, 100), np.full(500, 70.2)])

    def keep(angles):
        angles[400:, 3] = angles[399, 3]

    times = paused(len(phi), (400, pause))
    found = run(at(phi), change=keep, times=times)
    assert not wrong_while_checked(found, 3)
    # What goes out is declared: the bound holds the error.
    wrong = found.published & (found.error > 1.0)
    bounds = found.result.bounds[wrong, 3]
    assert (found.error[wrong] <= bounds).all()


def test_b_the_bound_of_a_sensor_is_infinite_until_its_rivals_are_known():
    """At a start on another solution it was 0.8 deg, 40 deg off."""
    pose = at([29.4])[0]
    still = np.repeat(pose[None], 400, 0)
    found = run(still, change=offset(0, 3, mirror(pose)))
    wrong = found.published & (found.error > 1.0)
    assert wrong.any()
    bounds = found.result.bounds[wrong, 3]
    assert (found.error[wrong] <= bounds).all()


@pytest.mark.parametrize(
    'axis',
    [
        (0.0, 0.0, 1.0),
        (1.0, 1.0, 1.0),
        (-0.54, 0.81, -0.22),
    ],
)
def test_v6_a_motion_on_which_the_parity_stays_zero_confirms_nothing(axis):
    """th3A is off from power on such that all fit another orientation; then it turns by 7 deg."""
    pose = at([29.4])[0]
    turns = np.radians(np.linspace(0.0, 7.5, 1500))
    turned = about(pose, np.array(axis), turns)
    found = run(turned, change=offset(0, 3, mirror(pose)))
    assert not wrong_while_checked(found, 3)


@pytest.mark.parametrize('sensor', [0, 2, 3])
def test_v5_five_sensors_at_power_on_have_rivals_too(sensor):
    """Two parities are no proof: four angles fit another orientation on a surface of poses."""
    tried = 0
    for tilt, azimuth, phi, size in POWER_ON[sensor]:
        still = np.repeat(at([phi], tilt, azimuth), 400, 0)
        found = run(still, 5, change=offset(0, sensor, size))
        tried += 1
        assert not wrong_while_checked(found, sensor)
    assert tried


@pytest.mark.parametrize('lost', few([20, 50, 90], count=2))
def test_v3_three_sensors_that_lose_samples_at_the_singularity_give_no_orientation(lost):
    """The last orientation selected the wrong one of two: 69 deg off, `degraded`."""
    at_rest = to_and_fro(25.0, 8.0, 300, 300)
    onwards = 25.0 + 0.3 * np.arange(200.0)
    phi = np.concatenate([at_rest, onwards])
    keep = np.ones(len(phi), bool)
    keep[650 : 650 + lost] = False
    found = run(
        at(phi),
        change=offset(400, 3, 20.0),
        keep=keep,
        degraded='allow',
    )
    assert 'degraded: joint_3a excluded' in found.states
    assert found.within_level


def test_v4_a_glitch_of_one_sensor_does_not_blame_it_for_the_drift_of_another():
    """th1B was excluded, 19 deg off after a second."""
    drift = ramp(540, 0, 30.0)
    for after in (2, 10, 40):
        glitch = offset(540 - after, 1, 6.0, 541 - after)
        found = run(
            'resting',
            seconds=1.2,
            change=every(glitch, drift),
            degraded='allow',
            alert_limit_deg=2.0,
        )
        assert 'degraded: joint_1b excluded' not in found.states
        assert found.within_level


def assert_none_but(sensor, found):
    """Assert that no other sensor was excluded."""
    for text in found.states:
        if 'excluded' in text:
            assert ALL_JOINT_NAMES[sensor] in text, found.states


@pytest.mark.parametrize('speed', few([1.0, 2.5, 4.0], count=2))
@pytest.mark.parametrize('azimuth', [0.0, 164.0])
@pytest.mark.parametrize(
    'axis',
    [
        (0.0, 0.0, 1.0),
        (1.0, -0.5, 0.2),
        (0.3, 1.0, -0.6),
    ],
)
def test_vx_a_stuck_sensor_of_five_is_never_found_by_one_sample_that_fits(speed, azimuth, axis):
    """11 deg off for 25 samples: the parity without a healthy sensor passes zero as it grows."""
    turn = np.concatenate([np.zeros(300), np.arange(300) * 1e-3 * speed])
    pose = at([53.2], 20.0, azimuth)[0]
    rotations = about(pose, np.array(axis), turn)
    for sensor in range(5):
        found = run(
            rotations,
            5,
            spoil=stuck(299, sensor),
            degraded='allow',
            seed=sensor,
        )
        if found is None:
            continue
        assert not wrong_while_checked(found, sensor)
        assert_none_but(sensor, found)


@pytest.mark.parametrize(
    ('tilt', 'azimuth', 'apart'),
    [
        (0.0, 0.0, 3.5),
        (12.0, 40.0, 3.5),
        (12.0, 160.0, 5.0),
    ],
)
def test_a_drift_of_th3a_through_the_singularity_is_detected_or_declared(tilt, azimuth, apart):
    """7 deg off at a level of 0.75 for ever: it passed to the other side of the fold unseen."""
    phi = to_and_fro(SINGULAR - apart, 10.0, 500, 1300)
    found = run(
        at(phi, tilt, azimuth),
        change=ramp(800, 3, 30.0),
        noise=0.006,
        bits=17,
        **FINE,
    )
    assert not wrong_while_checked(found, 3)


# Of five, `allow`: seed, which turns by the axis from a pose (tilt, azimuth, phi, deg) at a speed
# (rad/s) until th1A or th1B sticks. A healthy sensor of a passive joint was excluded.
STUCK = {
    'th1b': (
        8,
        1,
        (24.753, 245.983, 62.968),
        (-0.678, 0.6063, -0.4155),
        0.867,
    ),
    'th1a, slowly': (
        16,
        0,
        (14.378, 92.472, 5.855),
        (0.163, -0.2162, 0.9626),
        1.079,
    ),
    'th1a, at the rim': (
        112,
        0,
        (26.596, 149.331, 2.733),
        (0.9253, -0.2475, -0.2872),
        0.987,
    ),
    'th1a, hidden': (
        75,
        0,
        (24.804, 108.125, 50.852),
        (0.6951, -0.6443, -0.319),
        0.819,
    ),
}


@pytest.mark.parametrize('name', STUCK)
def test_vx_no_healthy_sensor_of_five_is_excluded_for_one_that_sticks(name):
    """5 to 7 deg off for up to 27 samples; a hypothesis stands until its trial has failed."""
    seed, sensor, pose, axis, speed = STUCK[name]
    index = np.arange(650)
    share = np.minimum(index / 200.0, 1.0)
    to_and_fro_first = np.radians(6.0 * np.sin(np.pi * share) ** 2)
    onwards = speed * np.maximum(index - 250, 0) * 1e-3
    turn = to_and_fro_first + onwards
    rotations = about(
        workspace_pose(*np.radians(pose)),
        np.array(axis),
        np.minimum(turn, 1.0),
    )
    angles = joint_angles(rotations, 5)
    reached = np.isfinite(angles).all(axis=1)
    count = len(reached) if reached.all() else int(np.argmin(reached))
    readings = encoders(angles[:count], seed=seed)
    readings[260:, sensor] = readings[260, sensor]
    found = Outcome(
        rotations[:count],
        readings,
        paused(count),
        degraded='allow',
    )
    assert_none_but(sensor, found)


# Ages -----------------------------------------------------------------------------------------


def test_v2_a_glitch_that_returns_to_a_wrong_motion_clears_nothing():
    """Two that jumped and stay were healthy 1 s after one wrong sample of either."""
    rig = Rig(recovery=0.1, alert_limit_deg=2.0)
    pair = {'th1a': 2.0, 'th1b': -1.87}
    rig.samples(100, **pair)
    rig.samples(1, th1a=7.0, th1b=-1.87)
    assert None not in rig.samples(500, **pair)
    assert rig.state == 'silent: joint_1a and joint_1b jumped, to be acknowledged'


def test_v7_nothing_lies_in_the_future_after_a_clock_that_was_set_back():
    """A stamp of an undetermined sample made every later jump one of no sensor."""
    rig = Rig(pose=(0.0, 0.0, 20.0))
    rig.supervisor._undetermined = rig.now
    rig.now -= 3_600_000 * MS
    rig.samples(200)
    assert rig.state == 'healthy'
    assert rig.samples(3, th3a=72.0)[0] != 'orientation not determined'


@pytest.mark.parametrize('value', [1e308, -1e308, 1e300])
def test_v8_a_reading_of_any_size_is_withheld_and_raises_nothing(value):
    rig = Rig()
    rig.place[1] = value
    assert rig.samples(3) == ['angle not finite'] * 3


@pytest.mark.parametrize('gone', few([20, 60, 150], count=2))
def test_s1_a_reading_that_is_missing_while_moving_is_no_jump_of_the_others(gone):
    """`two jumped, to be acknowledged`: the joints were not told of the skipped time."""

    def missing(readings):
        readings[400 : 400 + gone, 2] = np.nan

    found = run('turning', seconds=1.0, spoil=missing)
    assert not any('jumped' in text for text in found.states)
    assert found.published[400 + gone + 30 :].all()


@pytest.mark.parametrize(
    ('kind', 'first', 'gone'),
    [
        ('fast', 450, 20),
        ('sweep', 450, 150),
        ('rim', 450, 60),
    ],
)
@pytest.mark.parametrize('sensor', [0, 3])
def test_s1_in_fast_motion_the_others_are_told_of_the_skipped_time(kind, first, gone, sensor):
    """`joint_1a and joint_1c and joint_3a jumped, to be acknowledged`, and no orientation more."""

    def missing(readings):
        readings[first : first + gone, sensor] = np.nan

    found = run(kind, seconds=1.6, spoil=missing)
    assert not any('jumped' in text for text in found.states)


@pytest.mark.parametrize(
    ('size', 'apart'), few([4, 8, 16], [100, 10_000, 100_000], others=pytest.mark.evidence)
)
def test_s2_samples_in_bursts_are_no_jumps(size, apart):
    """Of a USB adapter: 4 to 16 ms of samples with stamps 0.1 to 100 us apart."""
    index = np.arange(2000)
    last = (index // size + 1) * size - 1
    times = 1_000_000_000 + last * MS - (last - index) * apart
    tilt = np.full(len(index), 8.0)
    azimuth = 40.0 * index * 1e-3
    phi = 30.0 + 20.0 * np.sin(index * 4e-3)
    rotations = workspace_pose(*np.radians([tilt, azimuth, phi]))
    for noise, bits in ((0.04, 14), (0.006, 17)):
        readings = encoders(joint_angles(rotations), noise, bits)
        found = Outcome(rotations, readings, times, sigma_deg=[noise] * 4)
        assert not any('jumped' in text for text in found.states)
        assert found.published[1000:].mean() > 0.95


def test_s3_six_exchange_a_sensor_that_healed_for_one_that_fails():
    """Two faults one after the other, the first healed meanwhile: silent for good."""
    healed = offset(100, 0, 3.0, 400)
    stays = offset(300, 5, 3.0)
    found = run(
        'sweep',
        6,
        1.2,
        change=every(healed, stays),
        recovery=0.3,
    )
    assert found.states[-1] == 'degraded: joint_3c excluded'
    assert found.published[-200:].all()
    assert found.within_level


def test_s4_the_time_unchecked_goes_on_through_pauses():
    """`unchecked_limit` began again with each pause of half a second."""
    rig = Rig(pose=(0.0, 0.0, SINGULAR), unchecked_limit=2.0)
    causes = []
    for _ in range(5):
        rig.now += 600 * MS
        causes += rig.samples(100)
    assert causes[-1] == 'joint_3a unchecked for too long'


def drift_and_back(seconds):
    """Return a fault: joint_1b drifts by 1.5 deg and back, begin, middle and end at times, s."""

    def change(angles):
        t = np.arange(len(angles)) * 1e-3
        share = np.interp(t, seconds, [0.0, 1.0, 0.0])
        angles[:, 1] += np.radians(1.5) * share

    return change


def test_s5_a_fault_of_a_sensor_that_is_not_determined_ends_with_checks_one_by_one():
    """joint_1b drifts by 1.5 deg and back: it was silent for good, and nothing could end it."""
    rest = to_and_fro(20.0, 8.0, 400, 400)
    # To the singularity's other side and back, so that each is checked, at different moments.
    turns = np.linspace(0.0, 4.0 * np.pi, 6000)
    move = 20.0 + 30.0 * (1.0 - np.cos(turns))
    phi = np.concatenate([rest, np.full(1500, 20.0), move])
    drift = drift_and_back([0.8, 1.4, 2.0])
    found = run(at(phi, 5.0, 30.0), change=drift, bias_deg=[0.03] * 4)
    assert any('undetermined' in text for text in found.states)
    assert found.published[-1]
    assert found.within_level


@pytest.mark.parametrize(
    'alert_limit_deg',
    [
        0.7,
        pytest.param(0.8, marks=pytest.mark.evidence),
    ],
)
def test_s5_no_moment_is_needed_at_which_all_are_checked(alert_limit_deg):
    """th1C and th3A are checked in different places: it was silent for good."""
    turns = np.concatenate(
        [
            np.linspace(0.0, 2.0, 2000),
            np.zeros(1500),
            np.linspace(0.0, 4.0, 8000),
        ]
    )
    rotations = at(26.0 + 16.0 * np.sin(np.pi * turns))
    drift = drift_and_back([2.2, 2.6, 3.0])
    found = run(rotations, change=drift, alert_limit_deg=alert_limit_deg)
    assert not (found.result.unchecked == 0.0).all(axis=1).any()
    assert any('undetermined' in text for text in found.states)
    assert found.states[-1] == 'healthy'
    assert found.within_level


def test_s5_an_acknowledgement_says_what_it_ended_and_what_still_waits():
    rig = Rig(pose=(0.0, 0.0, SINGULAR), recovery=0.1)
    for index in range(400):
        rig.sample(th1b=0.01 * index)
    rig.samples(300)
    assert 'waits until checked: ' in rig.state
    assert 'joint_3a; ' in rig.state
    assert 'turn the handle about its axis' in rig.state
    answer = rig.supervisor.acknowledge()
    assert 'sensor undetermined' in answer.ended
    assert '0.1 s' in answer.waits
    rig.samples(200)
    assert rig.state == 'healthy'
    assert rig.supervisor.acknowledge() == ('', '')


@pytest.mark.parametrize('rate', few([50.0, 250.0, 1000.0], count=2))
def test_s6_stamps_that_go_back_are_silence_within_20_ms(rate):
    """Up to 100 samples, 2 s at 50 Hz, were silent while `state` said healthy."""
    rig = Rig()
    period = 1000.0 / rate
    for _ in range(200):
        rig.sample(after=period)
    assert rig.state == 'healthy'
    back = rig.now - 60_000 * MS
    for index in range(1, 2 + int(20.0 / period)):
        rig.sample(stamp=back + round(index * period * MS))
    assert rig.state != 'healthy'


# One look, and what was hidden ------------------------------------------------------------------


def test_a_solution_that_noise_hides_once_is_found_with_the_next_sample():
    """A hypothesis was over after one look, and its sensor checked for good."""
    rig = Rig(
        pose=(0.0, 0.0, 20.0),
        healthy=False,
        alert_limit_deg=2.0,
    )
    sensors = rig.supervisor._sensors
    without_th3a = sensors.without(3)
    every = without_th3a.every
    looks = []

    def hidden_once(sample):
        """Return all orientations, but for the first time only that of the platform."""
        looks.append(sample.stamp)
        if len(looks) > 1:
            return every(sample)
        here = sensors.used.estimate.quaternion
        return [each for each in every(sample) if rotation_distance(each.quaternion, here) < 0.1]

    without_th3a.every = hidden_once
    rig.samples(100)
    assert np.isinf(rig.supervisor.unchecked()[3])
    assert np.isfinite(rig.supervisor.parts[3])
    assert rig.supervisor.parts[3] > np.radians(20.0)
    assert len(looks) == 3


def test_a_hidden_sensor_that_drifted_is_followed_from_before_it_was_hidden():
    """The trial without it began at the orientation that its own drift had made."""
    rig = Rig(pose=(0.0, 0.0, SINGULAR - 20.0))
    rivals = rig.supervisor._rivals
    before = rivals.last
    assert rivals.place_without(3) == before
    rivals._hidden[3] = before
    moved = quaternion_from_matrix(workspace_pose(0.0, 0.0, 0.6))
    rivals.last = replace(before, quaternion=tuple(moved.tolist()))
    assert rivals.place_without(3) == before
    assert rivals.place_without(0) == rivals.last


def test_of_four_none_is_excluded_while_another_may_have_drifted_unseen():
    """th3A drifts at the singularity, then th1A is shaken: without th1A it was 4 deg off."""
    phi = np.concatenate(
        [
            to_and_fro(SINGULAR - 12.0, 8.0, 400, 200),
            np.linspace(SINGULAR - 12.0, SINGULAR, 300),
            np.full(600, SINGULAR),
        ]
    )

    def drift(angles):
        share = np.minimum(2e-3 * np.arange(len(angles) - 900), 1.0)
        angles[900:, 3] += np.radians(4.0) * share

    shaken = offset(1450, 0, 3.0, 1460)
    found = run(at(phi), change=every(drift, shaken), degraded='allow')
    assert not any('joint_1a excluded' in text for text in found.states)


# Poses and offsets, deg, of a sensor of five with which four angles fit another orientation.
POWER_ON = {
    0: [
        (22.0, 0.0, 30.0, 16.0),
        (24.0, 120.0, 30.0, -18.0),
        (26.0, 240.0, 10.0, 22.0),
    ],
    2: [
        (22.0, 60.0, 30.0, 16.0),
        (20.0, 180.0, 40.0, -18.0),
    ],
    3: [
        (22.0, 0.0, 30.0, 16.0),
        (24.0, 60.0, 30.0, 18.0),
        (26.0, 300.0, 60.0, 22.0),
    ],
}
