# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The file of a simulated rig: JSON with its mechanism and the errors of its sensors."""

from __future__ import annotations

from collections.abc import Callable
import json
from math import degrees, radians
from pathlib import Path
from typing import Any

from spm_haptic_master.exceptions import GeometryError, InputError, quoted
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.simulation.rig import Rig, SensorErrors

# Number of legs.
LEGS = 3
# Largest coefficient of a harmonic, play, noise and resolution (deg), and delay (s): with more the
# value was not meant, and up to it an encoder's reading grows with the angle.
LARGEST_DEG, LONGEST_DELAY = 10.0, 0.1
# Range of a link angle (deg), as that of the geometry's parameters.
LINK_RANGE = (0.1, 179.9)
# Keys of the mechanism, of the sensors, and of the encoders' scale, which is not simulated.
MECHANISM_KEYS = ('alpha_deg', 'beta_deg', 'base_axes', 'platform_axes')
SENSOR_KEYS = ('eccentricity_deg_cos_sin', 'second_harmonic_deg', 'play_deg', 'noise_deg',
               'resolution_deg', 'delay')
SCALE_KEYS = ('zero', 'direction')


def read_rig(path: str | Path, drawn: Geometry, noise: float,
             sensors: int = len(JOINT_NAMES)) -> Rig:
    """
    Return the rig of a file.

    Parameters
    ----------
    path : str or Path
        JSON file; a key that it lacks leaves that part perfect.
    drawn : Geometry
        Mechanism for the keys that the file lacks.
    noise : float
        Standard deviation of each sensor, rad, if the file has none.
    sensors : int
        Number of sensors: the length of the file's lists.

    Raises
    ------
    InputError
        The file cannot be read, has an unknown key, or a value that a rig cannot have.

    """
    try:
        content = json.loads(Path(path).read_text(encoding='utf-8'),
                             object_pairs_hook=_without_repeats)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f'{path}: cannot be read: {" ".join(str(error).split())}') from error
    if not isinstance(content, dict):
        raise InputError(f'{path}: not a rig ({quoted(content)}); expected a JSON object')
    return _Reader(str(path), content, sensors).rig(drawn, noise)


def rig_text(rig: Rig) -> str:
    """Return the content of a file that `read_rig` makes the same rig of."""
    g, sensors = rig.geometry, rig.sensors

    def pairs(harmonics: list[tuple[float, float]]) -> list[list[float]]:
        return [[degrees(each) for each in pair] for pair in harmonics]

    content = {
        'alpha_deg': [degrees(angle) for angle in g.alphas],
        'beta_deg': [degrees(angle) for angle in g.betas],
        'base_axes': g.base_axes, 'platform_axes': g.platform_axes,
        'eccentricity_deg_cos_sin': pairs([each.first_harmonic for each in sensors]),
        'second_harmonic_deg': pairs([each.second_harmonic for each in sensors]),
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


class _Reader:
    """Takes the values of a rig from the content of its file."""

    def __init__(self, path: str, content: dict[str, Any], sensors: int):
        self._path = path
        self._sensors = sensors
        self._content = content

    def rig(self, drawn: Geometry, noise: float) -> Rig:
        known = (*MECHANISM_KEYS, *SENSOR_KEYS, *SCALE_KEYS)
        for key, value in self._content.items():
            if key not in known:
                raise self._error(key, value, f'one of the keys {", ".join(known)}')
        self._check_scale()
        return Rig(self._geometry(drawn), self._errors(noise))

    def _geometry(self, drawn: Geometry) -> Geometry:
        if not any(key in self._content for key in MECHANISM_KEYS):
            return drawn
        angles = [self._numbers(key, (LEGS,), *LINK_RANGE) for key in ('alpha_deg', 'beta_deg')]
        axes = [self._numbers(key, (LEGS, 3), -1.0, 1.0) for key in ('base_axes', 'platform_axes')]
        alphas, betas = (
            default if given is None else list(map(radians, given))
            for given, default in zip(angles, (drawn.alphas, drawn.betas), strict=True))
        base, platform = (
            default if given is None else given
            for given, default in zip(axes, (drawn.base_axes, drawn.platform_axes), strict=True))
        try:
            return Geometry.from_axes(base, platform, alphas, betas)
        except GeometryError as error:
            raise InputError(f'{self._path}: {error}') from error

    def _errors(self, noise: float) -> tuple[SensorErrors, ...]:
        number = self._sensors

        def harmonics(key: str) -> list[tuple[float, float]]:
            given = self._numbers(key, (number, 2), -LARGEST_DEG, LARGEST_DEG)
            return [(radians(c), radians(s)) for c, s in given or [(0.0, 0.0)] * number]

        def sizes(key: str, default: float) -> list[float]:
            given = self._numbers(key, (number,), 0.0, LARGEST_DEG)
            return [default] * number if given is None else list(map(radians, given))

        delays = self._numbers('delay', (number,), 0.0, LONGEST_DELAY) or [0.0] * number
        return tuple(map(
            SensorErrors, harmonics('eccentricity_deg_cos_sin'),
            harmonics('second_harmonic_deg'), sizes('play_deg', 0.0), sizes('noise_deg', noise),
            sizes('resolution_deg', 0.0), delays))

    def _check_scale(self) -> None:
        """Check zero counts and directions, which the parameters `encoders.*` set."""
        self._list('zero', (self._sensors,), lambda value: type(value) is int and value >= 0,
                   'an integer of at least 0')
        self._list('direction', (self._sensors,), lambda value: type(value) is int
                   and value in (1, -1), '1 or -1')

    def _numbers(self, key: str, shape: tuple[int, ...], least: float, most: float) -> Any:
        """Return the nested lists of numbers of a key, None without it."""
        return self._list(key, shape, lambda value: type(value) in (int, float)
                          and least <= value <= most, f'a number from {least:g} to {most:g}')

    def _list(self, key: str, shape: tuple[int, ...], fits: Callable[[Any], bool],
              each: str) -> Any:
        """Return the nested lists of a key, None without it; InputError if they do not fit."""
        if key not in self._content:
            return None
        value = self._content[key]

        def check(part: Any, rest: tuple[int, ...]) -> bool:
            if not rest:
                return fits(part)
            return isinstance(part, list) and len(part) == rest[0] and all(
                check(element, rest[1:]) for element in part)

        if not check(value, shape):
            raise self._error(key, value, ' of '.join(
                f'{"lists" if depth else "a list"} of {count}'
                for depth, count in enumerate(shape)) + f', each {each}')
        return value

    def _error(self, key: str, value: Any, expected: str) -> InputError:
        return InputError(f"{self._path}: key '{key}' is {quoted(value)}; expected {expected}")
