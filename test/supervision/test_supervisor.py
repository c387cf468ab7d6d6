# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of one of four sensors: when they are detected, and what was published before."""

from device import encoders, joint_angles, motion, noisy, offset, Outcome, ramp, run, stamps, stuck
import numpy as np
import pytest
from rig import few
from spm_haptic_master.kinematics import inverse
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.simulation.rig import random_rig, Tolerances
from spm_haptic_master.supervision import supervise

SENSORS = (0, 3, 1, 2)
PLACES = ['rest', 'rim', 'crossing', 'turning', 'sweep']


# Steps ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(('place', 'sensor', 'step'), few(PLACES, SENSORS, [1.0, -3.0, 30.0]))
def test_a_step_is_detected_and_a_large_one_at_once_and_named(place, sensor, step):
    outcome = run(
        place,
        seconds=0.25,
        change=offset(150, sensor, step),
        seed=sensor,
    )
    assert outcome.published[5:150].all()
    assert outcome.longest_undeclared(sensor) <= 0.02
    if abs(step) > 1.0:
        assert not outcome.published[152:].any()
        assert JOINT_NAMES[sensor] in outcome.states[-1]


@pytest.mark.parametrize(
    ('place', 'sensor', 'step'), few(['rest', 'rim', 'sweep'], SENSORS, [0.3, 0.5, 0.8])
)
@pytest.mark.parametrize(
    'seeds',
    [
        pytest.param(range(1), id='few'),
        pytest.param(range(1, 5), id='more', marks=pytest.mark.evidence),
    ],
)
def test_after_its_detection_a_smaller_step_never_comes_through(place, sensor, step, seeds):
    for seed in seeds:
        outcome = run(
            place,
            seconds=0.4,
            change=offset(150, sensor, step),
            seed=seed,
        )
        detected = np.flatnonzero(~outcome.published[150:])
        late = slice(150 + (detected[0] if len(detected) else 0), None)
        assert not np.any(outcome.error[late] > outcome.level[late])


@pytest.mark.parametrize(('rate', 'sensor'), few([100.0, 250.0, 1000.0, 4000.0], SENSORS))
def test_the_time_to_alert_holds_at_every_rate(rate, sensor):
    count = int(min(2.0 * rate, 900.0))
    outcome = run(
        'turning',
        4,
        count / rate,
        rate,
        offset(count // 2, sensor, 1.5),
    )
    assert outcome.longest_undeclared(sensor, rate) <= max(0.02, 10.0 / rate)
    assert not outcome.published[count * 2 // 3 :].any()


@pytest.mark.parametrize('sensor', few(range(3), count=1))
def test_a_small_offset_that_creeps_in_is_detected_but_not_named(sensor):
    """1 deg/s: no jump, and within the human motion limit."""
    outcome = run('resting', change=ramp(600, sensor, 1.0), seed=sensor)
    seen = np.flatnonzero(~outcome.published[5:])[0] + 5
    assert 600 < seen < 1100
    assert not outcome.published[seen:].any()
    assert 'sensor undetermined' in outcome.states[-1]
    assert np.all(outcome.result.unchecked[600:seen] == 0.0)
    assert outcome.within_level


@pytest.mark.parametrize(
    ('encoder', 'jump'),
    few(
        [(0.04, 12), (0.04, 14), (0.006, 17)],
        [('singular', 3, 5.0), ('rest', [0, 1], [2.0, -1.87])],
    ),
)
def test_a_jump_that_no_parity_shows_is_detected_with_any_noise_before_it(encoder, jump):
    """Of th3A at the singularity; of th1A and th1B such that it leaves the parity as it is."""
    (noise, bits), (kind, sensors, degrees) = encoder, jump
    for seed in range(4):
        assert not run(
            kind,
            seconds=0.18,
            change=offset(150, sensors, degrees),
            noise=noise,
            bits=bits,
            seed=seed,
            sigma_deg=[noise] * 4,
        ).published[-1]


def constant(first, sensor, value):
    def change(readings):
        readings[first:, sensor] = value

    return change


@pytest.mark.parametrize(
    ('fault', 'kind', 'sensor'),
    few(
        [(noisy, 2.0), (constant, 0.0), (constant, 2.0 * np.pi)],
        ['crossing', 'sweep'],
        SENSORS,
    ),
)
def test_wrong_values_are_published_no_longer_than_the_time_to_alert(fault, kind, sensor):
    change, size = fault
    outcome = run(kind, seconds=1.0, spoil=change(600, sensor, size))
    assert outcome.published[5:600].all()
    assert outcome.longest_undeclared(sensor) <= 0.02
    assert outcome.published[600:].sum() <= (40 if change is noisy else 0)


@pytest.mark.parametrize('sensor', few(SENSORS, count=2))
def test_a_value_stuck_while_moving_is_named(sensor):
    outcome = run('taught', spoil=stuck(1500, sensor), seed=sensor)
    assert outcome.published[5:1500].all()
    seen = np.flatnonzero(~outcome.published[1500:])[0] + 1500
    assert seen <= 1520
    assert not outcome.published[seen:].any()
    assert JOINT_NAMES[sensor] in outcome.states[2]
    assert outcome.within_level


@pytest.mark.parametrize('noise', few([0.04, 0.0], count=1))
def test_th3a_stuck_at_the_singularity_is_frozen_or_declared_unchecked(noise):
    """No parity shows it: the repeats do, of a sensor that is known to be noisy."""
    if noise:
        outcome = run('taught singular', spoil=stuck(1500, 3))
        assert outcome.published[5:1500].all()
        assert not outcome.published[1520:].any()
        assert 'joint_3a frozen' in outcome.states[-1]
        early = run('near singular', seconds=1.0, spoil=stuck(500, 3))
        assert np.all(early.result.unchecked[:, 3] > 0.0)
    else:
        rotations = motion('crossing', 20.0)[2000:8000]
        outcome = run(rotations, spoil=stuck(2000, 3), noise=noise)
        assert outcome.longest_undeclared(3) <= 0.02
        # Where the others check it again, it is a fault.
        assert outcome.states[-1].startswith('silent')


def test_a_fault_that_the_parity_cannot_show_is_not_cleared():
    outcome = run(
        'singular',
        seconds=1.5,
        change=offset(500, 3, 2.0),
        recovery=0.5,
    )
    assert not outcome.published[500:].any()
    assert 'joint_3a jumped' in outcome.states[-1]


# Another mechanism ----------------------------------------------------------------------------


def test_only_with_its_own_mechanism_a_rig_is_published():
    """Links and axes off by 0.25 deg (1 sigma)."""
    built = random_rig(1, Tolerances(*np.radians([0.25, 0.25, 0.0, 0.0]))).geometry
    rotations = motion('sweep', 8.0, 250.0)
    joints = inverse(rotations, built)
    readings = encoders(np.column_stack([joints.theta1, joints.theta3a]))
    own = Outcome(
        rotations,
        readings,
        rate=250.0,
        geometry__base_axes=built.base_axes,
        geometry__platform_axes=built.platform_axes,
        geometry__proximal_deg=np.degrees(built.alphas),
        geometry__distal_deg=np.degrees(built.betas),
    )
    assert own.published[4:].mean() > 0.99
    assert own.within_level
    assert Outcome(rotations, readings, rate=250.0).published.mean() < 0.5


@pytest.mark.parametrize('sensor', few(SENSORS, count=1))
def test_a_value_stuck_before_its_noise_is_known_is_detected_by_the_others(sensor):
    outcome = run(
        'turning',
        seconds=1.1,
        spoil=stuck(1000, sensor),
        seed=sensor,
    )
    assert outcome.published[5:1000].all()
    assert not outcome.published[1060:].any()
    assert outcome.longest_undeclared(sensor) <= 0.02
    # And wrong by less than the alert limit until then.
    assert np.nanmax(outcome.error[1000:]) < 0.5


def test_four_go_on_without_a_fifth_although_not_each_of_them_was_checked():
    """Four check each other, unlike three; at this alert limit none of five counts as checked."""
    angles = encoders(joint_angles(motion('rest', 1.2), 5), 0.04, 14, seed=1)
    angles[1000:, 1] += np.radians(5.0)
    result = supervise(stamps(len(angles)), angles, alert_limit_deg=0.3, degraded='allow')
    assert np.isinf(result.unchecked[999]).all()
    assert result.state[-1] == (1002, 'degraded: joint_1b excluded')
