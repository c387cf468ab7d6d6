# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The file of a simulated rig: JSON with its mechanism and the errors of its sensors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import json
from math import degrees, radians
from pathlib import Path
from typing import Any

from spm_haptic_master.exceptions import GeometryError, InputError, quoted
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.simulation.rig import Rig, SensorErrors

# What the value of a key is: the lengths of its nested lists (ALL: the number of sensors), whether
# an element fits, and what is expected of it.
Kind = tuple[tuple[int, ...], Callable[[Any], bool], str]
ALL = 0


def _numbers(shape: tuple[int, ...], least: float, most: float) -> Kind:
    return shape, lambda value: type(value) in (int, float) and least <= value <= most, \
        f'a number from {least:g} to {most:g}'


# Keys of the mechanism; the range of a link angle is that of the geometry's parameters.
MECHANISM = {
    'alpha_deg': _numbers((3,), 0.1, 179.9), 'beta_deg': _numbers((3,), 0.1, 179.9),
    'base_axes': _numbers((3, 3), -1.0, 1.0), 'platform_axes': _numbers((3, 3), -1.0, 1.0)}
# Further keys: of the sensors (beyond these ranges the value was not meant, and within them an
# encoder's reading grows with the angle), and of the encoders' scale, which is only checked:
# the parameters `encoders.*` set it.
KEYS = MECHANISM | {
    'eccentricity_deg_cos_sin': _numbers((ALL, 2), -10.0, 10.0),
    'second_harmonic_deg': _numbers((ALL, 2), -10.0, 10.0),
    'play_deg': _numbers((ALL,), 0.0, 10.0), 'noise_deg': _numbers((ALL,), 0.0, 10.0),
    'resolution_deg': _numbers((ALL,), 0.0, 10.0), 'delay': _numbers((ALL,), 0.0, 0.1),
    'zero': ((ALL,), lambda value: type(value) is int and value >= 0, 'an integer of at least 0'),
    'direction': ((ALL,), lambda value: type(value) is int and value in (1, -1), '1 or -1')}


def read_rig(path: str | Path, drawn: Geometry, noise: float,
             sensors: int = len(JOINT_NAMES)) -> Rig:
    """
    Return the rig of a JSON file, whose lists have one element for each of the sensors.

    A key that it lacks leaves that part perfect: of the mechanism as drawn, of the noise (rad) as
    given. InputError: it cannot be read, or has a key or a value that a rig cannot have.
    """
    try:
        content = json.loads(Path(path).read_text(encoding='utf-8'),
                             object_pairs_hook=_without_repeats)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f'{path}: cannot be read: {" ".join(str(error).split())}') from error
    if not isinstance(content, dict):
        raise InputError(f'{path}: not a rig ({quoted(content)}); expected a JSON object')
    for key, value in content.items():
        if expected := _complaint(key, value, sensors):
            raise InputError(f"{path}: key '{key}' is {quoted(value)}; expected {expected}")

    def angles(key: str, default: Sequence[float]) -> Sequence[float]:
        return list(map(radians, content[key])) if key in content else default

    def harmonics(key: str) -> list[tuple[float, float]]:
        return [(radians(c), radians(s)) for c, s in content.get(key, [(0.0, 0.0)] * sensors)]

    mechanism, none = drawn, [0.0] * sensors
    if MECHANISM.keys() & content:
        try:
            mechanism = Geometry.from_axes(
                content.get('base_axes', drawn.base_axes),
                content.get('platform_axes', drawn.platform_axes),
                angles('alpha_deg', drawn.alphas), angles('beta_deg', drawn.betas))
        except GeometryError as error:
            raise InputError(f'{path}: {error}') from error
    return Rig(mechanism, tuple(map(
        SensorErrors, harmonics('eccentricity_deg_cos_sin'), harmonics('second_harmonic_deg'),
        angles('play_deg', none), angles('noise_deg', [noise] * sensors),
        angles('resolution_deg', none), content.get('delay', none))))


def rig_text(rig: Rig) -> str:
    """Return the content of a file that `read_rig` makes the same rig of."""
    g, sensors = rig.geometry, rig.sensors
    content = {
        'alpha_deg': list(map(degrees, g.alphas)), 'beta_deg': list(map(degrees, g.betas)),
        'base_axes': g.base_axes, 'platform_axes': g.platform_axes,
        'eccentricity_deg_cos_sin': [list(map(degrees, each.first_harmonic)) for each in sensors],
        'second_harmonic_deg': [list(map(degrees, each.second_harmonic)) for each in sensors],
        'play_deg': [degrees(each.play) for each in sensors],
        'noise_deg': [degrees(each.noise) for each in sensors],
        'resolution_deg': [degrees(each.resolution) for each in sensors],
        'delay': [each.delay for each in sensors]}
    return '{\n' + ',\n'.join(
        f' {json.dumps(key)}: {json.dumps(value)}' for key, value in content.items()) + '\n}\n'


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    keys = [key for key, _ in pairs]
    for key in keys:
        if keys.count(key) > 1:
            raise ValueError(f"key '{key}' is there twice")
    return dict(pairs)


def _complaint(key: str, value: Any, sensors: int) -> str:
    """Return what is expected instead of a key or its value; empty if it fits."""
    if key not in KEYS:
        return f'one of the keys {", ".join(KEYS)}'
    shape, fits, each = KEYS[key]
    lengths = tuple(length or sensors for length in shape)

    def check(part: Any, rest: tuple[int, ...]) -> bool:
        if not rest:
            return fits(part)
        return isinstance(part, list) and len(part) == rest[0] and all(
            check(element, rest[1:]) for element in part)

    if check(value, lengths):
        return ''
    return ' of '.join(f'{"lists" if depth else "a list"} of {length}'
                       for depth, length in enumerate(lengths)) + f', each {each}'
