# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The kinds of faults with which `benchmarks.integrity_attack` attacks, each set up by its choices.

Where it helps, a choice is relative to what would deceive best: the offset with which a sensor
reads as at another orientation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

from benchmarks.attack_device import turns, wrapped
from benchmarks.attack_scene import (
    Case,
    Choices,
    HAND_SPEED,
    Impossible,
    Scene,
    thinned,
)
import numpy as np
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

Array = Any

# Self-rotation at the parallel singularity in the workspace's centre, deg.
SINGULAR_DEG = 49.36
# Time in which a turn comes to its speed, over some four (s).
RISE_TIME = 0.012


def named(sensors: Sequence[int]) -> str:
    """Return the names of sensors."""
    return ' and '.join(ALL_JOINT_NAMES[sensor] for sensor in sensors)


def degrees_text(angle: float) -> str:
    """Return an angle, rad, in words."""
    return f'{np.degrees(angle):.2f} deg'


# The kinds ------------------------------------------------------------------------------------


def step_onto_another_solution(choices: Choices) -> Case:
    """Let a sensor step onto another solution, at rest or just before a motion."""
    scene = Scene(choices)
    times = scene.times()
    sensor = scene.sensor()
    pose = scene.pose()
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    offset = scene.offset_to(scene.rival(pose, sensor), pose, sensor)
    angles[times >= 0.0, sensor] += offset
    kept = np.ones(len(times), bool)
    lost = choices.one_of('lost', (0, 0, 0, 1, 3, 6, 12))
    kept[(times < 0.0) & (times >= -(lost + 0.5) / scene.rate)] = False
    words = f'{named([sensor])} steps by {degrees_text(offset)} after {lost} lost samples'
    return thinned(scene.case(rotations, times, angles, (sensor,), words), kept)


def pause_with_a_kept_value(choices: Choices) -> Case:
    """Turn the handle in a pause without samples, in which a sensor keeps its value."""
    scene = Scene(choices)
    times = scene.times()
    sensor = scene.sensor()
    after = scene.pose()
    pause = choices.scaled('pause', 0.02, 3.0)
    # Before the pause the sensor reads what it reads at a rival of the place after it.
    before = scene.rival(after, sensor)
    vector = choices.between('aside', 0.0, np.radians(20.0)) * choices.axis('aside')
    row = scene.device.rates(before)[sensor]
    vector = vector - row * (row @ vector) / (row @ row)
    before = turns(vector) @ before
    if np.linalg.norm(before - after) / np.sqrt(2.0) > HAND_SPEED * pause:
        raise Impossible
    rotations = scene.swing(before, times)
    rotations[times >= 0.0] = after
    rotations = scene.moved_after(rotations, times)
    is_late = times >= 0.0
    angles = np.concatenate(
        [scene.true_readings(rotations[~is_late]), scene.true_readings(rotations[is_late])]
    )
    kept_value = scene.device.readings(before)[sensor]
    if choices.number('stuck') < 0.5:
        angles[is_late, sensor] = kept_value
    else:
        angles[is_late, sensor] += kept_value - scene.device.readings(after)[sensor]
    times = np.where(is_late, times + pause, times)
    words = f'{named([sensor])} keeps its value in a pause of {1e3 * pause:.0f} ms'
    return scene.case(rotations, times, angles, (sensor,), words)


def glitch_after_a_pair(choices: Choices) -> Case:
    """Let two sensors jump so that the parity stays; later one is wrong for a moment."""
    scene = Scene(choices)
    times = scene.times(after=choices.between('length', 1.3, 2.2))
    pose = scene.pose()
    rotations = scene.swing(pose, times)
    angles = scene.true_readings(rotations)
    pair = choices.one_of('pair', ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3)))
    parity = np.linalg.svd(scene.device.rates(pose)[:4].T)[2][3]
    size = choices.sign('direction') * np.radians(choices.scaled('size', 1.0, 10.0))
    other = -size * parity[pair[0]] / parity[pair[1]]
    if abs(other) > np.radians(20.0):
        raise Impossible
    angles[times >= 0.0, pair[0]] += size
    angles[times >= 0.0, pair[1]] += other
    glitched = scene.sensor()
    begin = choices.between('glitch', 0.05, 0.6)
    length = choices.one_of('glitch length', (1, 2, 3, 6))
    start = int(np.searchsorted(times, begin))
    late = slice(start, start + length)
    angles[late, glitched] += np.radians(choices.between('glitch size', -30.0, 30.0))
    words = (
        f'{named(pair)} jump by {degrees_text(size)}, {degrees_text(other)}; after {begin:.2f} s '
        f'{length} samples of {named([glitched])} are wrong'
    )
    return scene.case(rotations, times, angles, pair, words, first=start + length, latched=True)


def three_sensors_and_lost_samples(choices: Choices) -> Case:
    """Leave three sensors, and lose samples while the device moves."""
    scene = Scene(choices)
    scene.settings['degraded'] = 'allow'
    sensor = scene.choices.one_of('sensor', (3, 3, 3, 0, 1, 2))
    times = scene.times(after=1.0)
    speed = choices.scaled('speed', 0.3, HAND_SPEED)
    length = choices.between('length', 0.1, 1.0)
    # The middle of the turn is near the singularity of the three active joints.
    middle = workspace_pose(
        *np.radians([choices.between('tilt', 0.0, 15.0), choices.between('azimuth', 0.0, 360.0)]),
        np.radians(SINGULAR_DEG + choices.between('beside', -8.0, 8.0)),
    )
    axis = middle[:, 2] if choices.number('about the platform') < 0.7 else choices.axis('turn')
    progress = np.clip((times - 0.3) * speed, 0.0, length) - 0.5 * length
    path = turns(progress[:, None] * axis)
    rotations = path @ scene.swing(middle, times)
    angles = scene.true_readings(rotations)
    size = choices.sign('direction') * np.radians(choices.between('size', 3.0, 40.0))
    angles[times >= 0.0, sensor] += size
    gap = choices.scaled('gap', 0.005, 0.2)
    centre = 0.3 + choices.between('place', 0.2, 0.8) * length / speed
    kept = np.abs(times - centre) > 0.5 * gap
    words = (
        f'{named([sensor])} off by {degrees_text(size)}; then {1e3 * gap:.0f} ms lost '
        f'at {speed:.1f} rad/s'
    )
    return thinned(scene.case(rotations, times, angles, (sensor,), words), kept)


def glitch_then_drift(choices: Choices) -> Case:
    """Give one sensor some wrong samples, and soon after let another one drift."""
    scene = Scene(choices, choices.one_of('sensors', (4, 4, 5, 6)))
    scene.settings['degraded'] = 'allow'
    times = scene.times(after=0.8)
    pose = scene.pose()
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    sensor = scene.sensor()
    other = (sensor + 1 + int(choices.number('other') * (scene.sensors - 1))) % scene.sensors
    glitch = np.radians(choices.between('glitch size', -30.0, 30.0))
    count = choices.one_of('glitch length', (1, 1, 2, 3))
    begin = choices.scaled('wait', 0.002, 0.3)
    speed = choices.sign('direction') * np.radians(choices.scaled('drift', 0.5, 200.0))
    angles[:, sensor] += speed * np.maximum(times - begin, 0.0)
    words = (
        f'{count} wrong samples of {named([other])}, {1e3 * begin:.0f} ms later '
        f'{named([sensor])} drifts by {degrees_text(speed)}/s'
    )
    drift = scene.case(rotations, times, angles, (sensor,), words)
    start = int(np.searchsorted(times, 0.0))
    readings = drift.readings.copy()
    readings[start : start + count, other] += glitch
    return replace(drift, readings=wrapped(readings), without_first=drift.readings)


def power_on_with_five(choices: Choices) -> Case:
    """Power on five sensors; one is off where the other four fit elsewhere, too."""
    scene = Scene(choices, 5)
    sensor = scene.sensor()
    kept = tuple(each for each in range(5) if each != sensor)
    found = scene.device.meeting(kept, scene.pose(30.0), choices.axis('search'), scene.rng)
    if found is None:
        raise Impossible
    pose, rival = found
    return started(scene, pose, rival, sensor)


def started(scene: Scene, pose: Array, rival: Array, sensor: int) -> Case:
    """Return the case of a sensor that reads as at a rival from the first sample on."""
    times = scene.times()
    rotations = np.repeat(pose[None], len(times), axis=0)
    rotations = scene.moved_after(rotations, times)
    angles = scene.true_readings(rotations)
    offset = scene.offset_to(rival, pose, sensor)
    angles[:, sensor] += offset
    words = f'{named([sensor])} off by {degrees_text(offset)} from power on'
    return scene.case(rotations, times, angles, (sensor,), words)


def power_on(choices: Choices) -> Case:
    """Power on four sensors; one is off, onto another solution."""
    scene = Scene(choices)
    sensor = scene.sensor()
    pose = scene.pose(30.0)
    return started(scene, pose, scene.rival(pose, sensor), sensor)


def motion_without_parity(choices: Choices) -> Case:
    """Move so that the parity stays zero, while a sensor is off onto another solution."""
    scene = Scene(choices)
    sensor = choices.one_of('sensor', (3, 3, 3, 0, 1, 2))
    pose = scene.pose()
    rival = scene.rival(pose, sensor)
    is_from_start = choices.number('begin') < 0.7
    times = scene.times(after=max(0.6, 80.0 / scene.rate))
    path = blind_path(scene, pose, rival, sensor, choices.between('length', 0.02, 0.5))
    # The path, there and back or there alone, after the fault began.
    phase = np.clip((times - 0.05) / (times[-1] - 0.05), 0.0, 1.0) * np.pi
    if choices.number('back') < 0.5:
        phase = 2.0 * phase
    place = 0.5 * (1.0 - np.cos(phase)) * (len(path) - 1)
    index = np.minimum(place.astype(int), len(path) - 2)
    steps = [rotation_vector(after @ before.T) for before, after in pairwise(path)]
    rotations = turns((place - index)[:, None] * np.array(steps)[index]) @ np.array(path)[index]
    if not is_from_start:
        rotations[times < 0.0] = scene.swing(pose, times)[times < 0.0]
    angles = scene.true_readings(rotations)
    offset = scene.offset_to(rival, pose, sensor)
    angles[(times >= 0.0) | is_from_start, sensor] += offset
    begin = 'from power on' if is_from_start else 'at rest'
    words = f'{named([sensor])} off by {degrees_text(offset)} {begin}, motion without parity'
    return scene.case(rotations, times, angles, (sensor,), words)


def blind_path(scene: Scene, pose: Array, rival: Array, sensor: int, length: float) -> list[Array]:
    """Return orientations from a pose along which a rival goes on to fit all four readings."""
    wish = scene.choices.axis('path')
    path = [pose]
    count = 24
    kept = [each for each in range(4) if each != sensor]
    for _ in range(count):
        here, there = scene.device.rates(np.array([path[-1], rival]))
        if not (np.isfinite(here[:4]).all() and np.isfinite(there[:4]).all()):
            raise Impossible
        follow = np.linalg.pinv(there[kept]) @ here[kept]
        # The rival follows the other three; the faulty reading must change equally at both.
        blind = here[sensor] - there[sensor] @ follow
        direction = wish - blind * (blind @ wish) / max(blind @ blind, 1e-12)
        vector = length / count * direction / max(np.linalg.norm(direction), 1e-9)
        path.append(turns(vector) @ path[-1])
        rival = turns(follow @ vector) @ rival
        wish = direction
    return path


def rotation_vector(rotation: Array) -> Array:
    """Return the vector of a small rotation, rad."""
    vector = np.array(
        [
            rotation[2, 1] - rotation[1, 2],
            rotation[0, 2] - rotation[2, 0],
            rotation[1, 0] - rotation[0, 1],
        ]
    )
    sine = 0.5 * np.linalg.norm(vector)
    return 0.5 * vector * (np.arcsin(min(sine, 1.0)) / sine if sine > 1e-12 else 1.0)


def stuck_in_motion(choices: Choices) -> Case:
    """Let a sensor keep its value while the device moves."""
    scene = Scene(choices, choices.one_of('sensors', (5, 5, 5, 6)))
    scene.settings['degraded'] = 'allow'
    times = scene.times(after=0.5)
    sensor = scene.sensor()
    pose = scene.pose(28.0)
    speed = choices.scaled('speed', 0.3, 5.0)
    lead = choices.between('lead', 0.05, 0.3)
    tail = choices.between('tail', 0.03, 0.4)
    # The turn begins and ends within some 50 ms, before and after the fault.
    rise = np.logaddexp(0.0, (times + lead) / RISE_TIME) - np.logaddexp(
        0.0, (times - tail) / RISE_TIME
    )
    far = speed * RISE_TIME * rise
    rotations = turns((far - speed * lead)[:, None] * choices.axis('turn')) @ pose
    angles = scene.true_readings(rotations)
    angles[times >= 0.0, sensor] = angles[times >= 0.0, sensor][0]
    readings_words = f'{named([sensor])} stuck at {speed:.2f} rad/s'
    case = scene.case(rotations, times, angles, (sensor,), readings_words)
    late = case.stamps >= scene.stamps(np.zeros(1))[0]
    case.readings[late, sensor] = case.readings[late, sensor][0]
    return case


def clock_set_back(choices: Choices) -> Case:
    """Set the clock back; a sensor steps onto another solution around that time."""
    scene = Scene(choices)
    times = scene.times(after=max(0.8, 200.0 / scene.rate))
    sensor = scene.sensor()
    pose = scene.pose(36.0)
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    offset = scene.offset_to(scene.rival(pose, sensor), pose, sensor)
    begin = choices.between('begin', -0.05, 0.25)
    angles[times >= begin, sensor] += offset
    back = choices.scaled('back', 0.1, 3600.0)
    times = np.where(times >= 0.0, times - back, times)
    words = (
        f'the clock goes back by {back:.1f} s, {named([sensor])} steps by {degrees_text(offset)} '
        f'after {1e3 * begin:.0f} ms'
    )
    return scene.case(rotations, times, angles, (sensor,), words)


def step_below_the_limit(choices: Choices) -> Case:
    """Let a sensor step by any small angle, anywhere."""
    scene = Scene(choices)
    times = scene.times(after=0.25)
    sensor = scene.sensor()
    pose = scene.pose(32.0)
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    size = choices.sign('direction') * np.radians(choices.scaled('size', 0.02, 20.0))
    angles[times >= 0.0, sensor] += size
    words = f'{named([sensor])} steps by {degrees_text(size)}'
    return scene.case(rotations, times, angles, (sensor,), words)


def slow_drift(choices: Choices) -> Case:
    """Let a sensor drift, anywhere."""
    scene = Scene(choices, choices.one_of('sensors', (4, 4, 4, 5, 6)))
    times = scene.times(after=1.0)
    sensor = scene.sensor()
    pose = scene.pose(32.0)
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    speed = choices.sign('direction') * np.radians(choices.scaled('drift', 0.3, 100.0))
    angles[:, sensor] += speed * np.maximum(times, 0.0)
    words = f'{named([sensor])} drifts by {degrees_text(speed)}/s'
    return scene.case(rotations, times, angles, (sensor,), words)


def drift_through_the_singularity(choices: Choices) -> Case:
    """Let th3A drift beside the singularity, so that the orientation passes through it."""
    scene = Scene(choices)
    times = scene.times(after=1.0)
    tilt = choices.between('tilt', 0.0, 12.0)
    azimuth = choices.between('azimuth', 0.0, 360.0)
    phi = SINGULAR_DEG + choices.between('beside', -9.0, 9.0)
    pose = workspace_pose(*np.radians([tilt, azimuth, phi]))
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    speed = choices.sign('direction') * np.radians(choices.scaled('drift', 1.0, 150.0))
    length = choices.scaled('length', 0.05, 2.0)
    angles[:, 3] += speed * np.clip(times, 0.0, length)
    words = (
        f'{named([3])} drifts by {degrees_text(speed)}/s for {length:.2f} s, '
        f'{phi - SINGULAR_DEG:.1f} deg beside the singularity'
    )
    return scene.case(rotations, times, angles, (3,), words)


def wave_without_mean(choices: Choices) -> Case:
    """Let a sensor read too much and too little in turn."""
    scene = Scene(choices)
    times = scene.times(after=0.5)
    sensor = scene.sensor()
    pose = scene.pose(28.0)
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    period = 2 * choices.one_of('half period', (1, 2, 3, 4, 5, 6, 8, 12, 20, 40))
    index = np.arange(len(times))
    square = np.where((index // (period // 2)) % 2 == 0, 1.0, -1.0)
    wave = square if choices.number('square') < 0.6 else np.sin(2.0 * np.pi * index / period)
    size = np.radians(choices.scaled('size', 0.02, 5.0))
    angles[:, sensor] += np.where(times >= 0.0, size * wave, 0.0)
    words = f'{named([sensor])} off by +-{degrees_text(size)}, period of {period} samples'
    return scene.case(rotations, times, angles, (sensor,), words)


def healthy_at_the_rim(choices: Choices) -> Case:
    """Lose samples of healthy sensors near the end of the reach."""
    scene = Scene(choices, choices.one_of('sensors', (4, 4, 5, 6)))
    times = scene.times(after=0.6)
    pose = scene.pose(38.0)
    rotations = scene.moved_after(scene.swing(pose, times), times)
    angles = scene.true_readings(rotations)
    begin = choices.between('gap', -0.1, 0.4)
    length = choices.scaled('gap length', 0.002, 0.3)
    kept = (times < begin) | (times >= begin + length)
    words = f'healthy, {1e3 * length:.0f} ms lost'
    return thinned(scene.case(rotations, times, angles, (), words), kept)


def fault_of_an_unchecked_sensor(choices: Choices) -> Case:
    """Let a sensor be wrong where the others determine no orientation, with exclusion."""
    scene = Scene(choices, choices.one_of('sensors', (5, 5, 6)))
    scene.settings['degraded'] = 'allow'
    sensor = scene.sensor()
    kept = tuple(each for each in range(scene.sensors) if each != sensor)
    pose = scene.device.undetermined(kept, scene.pose(40.0), scene.rng)
    times = scene.times(after=0.8)
    rotations = scene.moved_after(np.repeat(pose[None], len(times), axis=0), times)
    angles = scene.true_readings(rotations)
    size = choices.sign('direction') * np.radians(choices.scaled('size', 0.2, 20.0))
    length = choices.one_of('length', (1e-6, 0.1, 0.3, 1.0))
    angles[:, sensor] += size * np.clip(times / length, 0.0, 1.0)
    words = f'{named([sensor])} off by {degrees_text(size)} within {length:.1f} s, hardly checked'
    return scene.case(rotations, times, angles, (sensor,), words)


KINDS: dict[str, Callable[[Choices], Case]] = {
    'step onto another solution': step_onto_another_solution,
    'pause in which a sensor keeps its value': pause_with_a_kept_value,
    'glitch after two that jumped': glitch_after_a_pair,
    'three sensors, samples lost': three_sensors_and_lost_samples,
    'glitch of one, drift of another': glitch_then_drift,
    'power on with an offset, five sensors': power_on_with_five,
    'power on with an offset': power_on,
    'motion on which the parity stays zero': motion_without_parity,
    'stuck in motion, with exclusion': stuck_in_motion,
    'clock set back': clock_set_back,
    'step anywhere': step_below_the_limit,
    'drift anywhere': slow_drift,
    'drift of th3A through the singularity': drift_through_the_singularity,
    'wave without mean': wave_without_mean,
    'healthy near the rim': healthy_at_the_rim,
    'fault where the others determine nothing': fault_of_an_unchecked_sensor,
}
