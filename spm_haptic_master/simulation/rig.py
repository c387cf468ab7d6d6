# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The rig that is simulated: its mechanism as built, the errors of its sensors, its JSON file.

A perfect rig is as drawn; a random one deviates by tolerances; a file has values of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import json
from math import cos, degrees, hypot, radians, sin
from pathlib import Path
import random
from typing import Any, NamedTuple

from spm_haptic_master.exceptions import GeometryError, InputError, quoted, SettingError
from spm_haptic_master.kinematics import Geometry, in_usual_frames
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values

# Cosine and sine coefficient of a harmonic.
Harmonic = tuple[float, float]
# Length of a list of all sensors.
ALL = 0


class NumberList(NamedTuple):
    """A value in a rig file: lengths of the nested lists, least and largest number."""

    lengths: tuple[int, ...]
    least: float
    most: float


# Keys of the mechanism; the range of a link angle is that of the geometry's parameters.
LINK_ANGLES = NumberList((3,), least=0.1, most=179.9)
AXES = NumberList((3, 3), least=-1.0, most=1.0)
MECHANISM = {
    'alpha_deg': LINK_ANGLES,
    'beta_deg': LINK_ANGLES,
    'base_axes': AXES,
    'platform_axes': AXES,
}
# Keys of the sensors' errors: their numbers (none beyond these ranges is meant, and within them an
# encoder's reading grows with the angle), and fields of SensorErrors.
HARMONICS = NumberList((ALL, 2), least=-10.0, most=10.0)
DEGREES = NumberList((ALL,), least=0.0, most=10.0)
ERRORS = {
    'eccentricity_deg_cos_sin': HARMONICS,
    'second_harmonic_deg': HARMONICS,
    'play_deg': DEGREES,
    'noise_deg': DEGREES,
    'resolution_deg': DEGREES,
    'delay': NumberList((ALL,), least=0.0, most=0.1),
}
FIELDS = {
    'eccentricity_deg_cos_sin': 'first_harmonic',
    'second_harmonic_deg': 'second_harmonic',
    'play_deg': 'play',
    'noise_deg': 'noise',
    'resolution_deg': 'resolution',
    'delay': 'delay',
}
# All keys; of the encoders' scale nothing is read: the parameters `encoders.*` set it.
KEYS = MECHANISM | ERRORS
NOT_READ = ('zero', 'direction')


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """
    Errors of one sensor's reading of the joint angle; all are 0 for a perfect sensor.

    Attributes
    ----------
    first_harmonic, second_harmonic : tuple of 2 float
        Cosine and sine coefficient of the error over one turn of the joint angle, rad: the
        encoder's eccentricity, and what repeats twice a turn.
    play : float
        Width of the play between joint and encoder, rad.
    noise : float
        Standard deviation, rad.
    resolution : float
        Smallest change of the reading, rad; 0: that of the counts.
    delay : float
        Age of the angle when the sensor is read, s.

    """

    first_harmonic: Harmonic = (0.0, 0.0)
    second_harmonic: Harmonic = (0.0, 0.0)
    play: float = 0.0
    noise: float = 0.0
    resolution: float = 0.0
    delay: float = 0.0

    def with_harmonics(self, angle: float) -> float:
        """
        Return the reading of a joint angle with the harmonics alone.

        Parameters
        ----------
        angle : float
            Joint angle, rad.

        Returns
        -------
        float
            The angle that the encoder measures, rad, without play, noise and resolution.

        """
        c1, s1 = self.first_harmonic
        c2, s2 = self.second_harmonic
        return (
            angle
            + c1 * cos(angle)
            + s1 * sin(angle)
            + c2 * cos(2.0 * angle)
            + s2 * sin(2.0 * angle)
        )


@dataclass(frozen=True, slots=True)
class Rig:
    """
    A simulated rig of four, five or six sensors.

    Attributes
    ----------
    geometry : Geometry
        Its mechanism, as built.
    sensors : tuple of N SensorErrors
        Errors of its sensors, in the order of ALL_JOINT_NAMES.

    """

    geometry: Geometry
    sensors: tuple[SensorErrors, ...]

    @property
    def has_harmonics(self) -> bool:
        """Whether any encoder's error repeats with its turn."""
        for sensor in self.sensors:
            if any(sensor.first_harmonic) or any(sensor.second_harmonic):
                return True
        return False


@dataclass(frozen=True, slots=True)
class Tolerances:
    """
    Standard deviations of the errors of a random rig.

    Attributes
    ----------
    links : float
        Of each of the six link angles, rad.
    axes : float
        Of each component of the six axes, before they are made unit vectors (about rad).
    first_harmonic, second_harmonic : float
        Of each coefficient of the encoders' harmonics, rad.

    """

    links: float = 0.0
    axes: float = 0.0
    first_harmonic: float = 0.0
    second_harmonic: float = 0.0


def perfect_rig(
    geometry: Geometry,
    noise: float,
    sensors: int = len(JOINT_NAMES),
) -> Rig:
    """
    Return a rig as drawn, with noise as its only error.

    Parameters
    ----------
    geometry : Geometry
        Its mechanism.
    noise : float
        Standard deviation of each sensor, rad.
    sensors : int
        Number of sensors.

    """
    return Rig(geometry, (SensorErrors(noise=noise),) * sensors)


def random_rig(
    seed: int,
    tolerances: Tolerances,
    geometry: Geometry | None = None,
    noise: float = 0.0,
    sensors: int = len(JOINT_NAMES),
) -> Rig:
    """
    Return a rig that deviates at random: the same seed gives the same rig.

    All deviations are normal, and for one seed in proportion to the tolerances; more sensors leave
    the others as they are. Its frames are those of `in_usual_frames`.

    Parameters
    ----------
    seed : int
        Seed of the deviations.
    tolerances : Tolerances
        Their standard deviations.
    geometry : Geometry, optional
        The mechanism that it deviates from; by default the paper's.
    noise : float
        Standard deviation of each sensor's noise, rad.
    sensors : int
        Number of sensors.

    Raises
    ------
    GeometryError
        The deviations make an impossible mechanism.

    """
    nominal = geometry or Geometry()
    gauss = random.Random(seed).gauss

    def deviation(size: float) -> float:
        return size * gauss(0.0, 1.0)

    def axes(nominal_axes: Sequence[Sequence[float]]) -> list[list[float]]:
        moved = []
        for axis in nominal_axes:
            moved.append([each + deviation(tolerances.axes) for each in axis])
        return [_unit(axis) for axis in moved]

    def harmonic(size: float) -> Harmonic:
        return deviation(size), deviation(size)

    alphas = [angle + deviation(tolerances.links) for angle in nominal.alphas]
    betas = [angle + deviation(tolerances.links) for angle in nominal.betas]
    base = axes(nominal.base_axes)
    platform = axes(nominal.platform_axes)
    built = Geometry.from_axes(base, platform, alphas, betas)
    errors = []
    for _ in range(sensors):
        errors.append(
            SensorErrors(
                first_harmonic=harmonic(tolerances.first_harmonic),
                second_harmonic=harmonic(tolerances.second_harmonic),
                noise=noise,
            )
        )
    return Rig(in_usual_frames(built, nominal), tuple(errors))


def _unit(axis: Sequence[float]) -> list[float]:
    """Return a vector of length 1 along an axis."""
    length = hypot(*axis)
    return [each / length for each in axis]


def _without_doubles(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return an object of a JSON file; ValueError for a key that is given twice."""
    content = dict(pairs)
    names = [name for name, _ in pairs]
    for name in content:
        if names.count(name) > 1:
            raise ValueError(f"key '{name}' is given twice")
    return content


def _mechanism(
    path: str | Path,
    content: dict[str, Any],
    drawn: Geometry,
) -> Geometry:
    """Return the mechanism of a rig's file; what it lacks is as drawn."""
    alphas = list(drawn.alphas)
    if 'alpha_deg' in content:
        alphas = list(map(radians, content['alpha_deg']))
    betas = list(drawn.betas)
    if 'beta_deg' in content:
        betas = list(map(radians, content['beta_deg']))
    try:
        return Geometry.from_axes(
            content.get('base_axes', drawn.base_axes),
            content.get('platform_axes', drawn.platform_axes),
            alphas,
            betas,
        )
    except GeometryError as error:
        raise InputError(f'{path}: {error}') from error


def read_rig(
    path: str | Path,
    drawn: Geometry,
    noise: float,
    sensors: int = len(JOINT_NAMES),
) -> Rig:
    """
    Return the rig of a JSON file, whose lists have one element for each of the sensors.

    Parameters
    ----------
    path : str or Path
        JSON file; a key that it lacks leaves that part perfect.
    drawn : Geometry
        Mechanism for the keys that the file lacks.
    noise : float
        Standard deviation of each sensor, rad, if the file has none.
    sensors : int
        Number of sensors.

    Raises
    ------
    InputError
        The file cannot be read, or has a key or a value that a rig cannot have.

    """
    content = _read_content(path, sensors)
    if MECHANISM.keys() & content:
        mechanism = _mechanism(path, content, drawn)
    else:
        mechanism = drawn
    errors = []
    for index in range(sensors):
        given: dict[str, Any] = {'noise': noise}
        for key, field in FIELDS.items():
            if key in content:
                given[field] = _converted(key, radians, content[key][index])
        errors.append(SensorErrors(**given))
    return Rig(mechanism, tuple(errors))


def _read_content(path: str | Path, sensors: int) -> dict[str, Any]:
    """
    Return the values of a rig's file, each of which fits its key.

    Parameters
    ----------
    path : str or Path
        JSON file.
    sensors : int
        Number of sensors: the length of a list of all of them.

    Raises
    ------
    InputError
        As of `read_rig`.

    """
    try:
        text = Path(path).read_text(encoding='utf-8')
        content = json.loads(text, object_pairs_hook=_without_doubles)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f'{path}: cannot be read: {" ".join(str(error).split())}') from error
    if not isinstance(content, dict):
        raise InputError(f'{path}: not a rig ({quoted(content)}); expected a JSON object')
    for key, value in content.items():
        if expected := _complaint(key, value, sensors):
            raise InputError(f"{path}: key '{key}' is {quoted(value)}; expected {expected}")
    return content


def rig_text(rig: Rig) -> str:
    """
    Return the content of a file that `read_rig` makes the same rig of.

    Parameters
    ----------
    rig : Rig
        The rig; its angles are written in deg, its delays in s.

    Returns
    -------
    str
        A JSON object with one line for each key.

    """
    g = rig.geometry
    content = {
        'alpha_deg': list(map(degrees, g.alphas)),
        'beta_deg': list(map(degrees, g.betas)),
        'base_axes': g.base_axes,
        'platform_axes': g.platform_axes,
    }
    for key, field in FIELDS.items():
        values = [getattr(sensor, field) for sensor in rig.sensors]
        content[key] = [_converted(key, degrees, value) for value in values]
    lines = []
    for key, value in content.items():
        lines.append(f' {json.dumps(key)}: {json.dumps(value)}')
    return '{\n' + ',\n'.join(lines) + '\n}\n'


def _converted(
    key: str,
    convert: Callable[[float], float],
    value: Any,
) -> Any:
    """Return an angle of a sensor, or a pair, converted; a `delay` as it is."""
    if key == 'delay':
        return value
    if isinstance(value, (list, tuple)):
        return tuple(map(convert, value))
    return convert(value)


def make_rig(values: Values) -> Rig:
    """
    Return the rig of checked settings: of a file, of a seed, or as drawn.

    Parameters
    ----------
    values : Values
        Checked values of the `sim.*` settings, the geometry and `sensors`.

    Raises
    ------
    SettingError
        Both a file and a seed are given.
    InputError
        As of `read_rig`.
    GeometryError
        As of `random_rig`.

    """
    geometry = geometry_from(values)
    noise = radians(values['sim.noise_deg'])
    path = values['sim.rig_file']
    seed = values['sim.rig_seed']
    sensors = values['sensors']
    if path and seed:
        raise SettingError(
            name='sim.rig_seed',
            value=seed,
            expected=f'0 with a sim.rig_file ({path})',
        )
    if path:
        return read_rig(path, geometry, noise, sensors)
    if seed:
        links_deg, axes_deg = values['sim.tolerance_deg']
        first_deg, second_deg = values['sim.harmonics_deg']
        tolerances = Tolerances(
            links=radians(links_deg),
            axes=radians(axes_deg),
            first_harmonic=radians(first_deg),
            second_harmonic=radians(second_deg),
        )
        return random_rig(
            seed=seed,
            tolerances=tolerances,
            geometry=geometry,
            noise=noise,
            sensors=sensors,
        )
    return perfect_rig(geometry, noise, sensors)


def _complaint(
    key: str,
    value: Any,
    sensors: int,
) -> str:
    """
    Return the expectation that a key or its value violates.

    Parameters
    ----------
    key : str
        Key of the file.
    value : object
        Its value, of any JSON type.
    sensors : int
        Number of sensors: the length of a list of all of them.

    Returns
    -------
    str
        What was expected; empty if the value fits.

    """
    if key in NOT_READ:
        return ''
    if key not in KEYS:
        return f'one of the keys {", ".join((*KEYS, *NOT_READ))}'
    wanted = KEYS[key]
    lengths = [length or sensors for length in wanted.lengths]

    def fits(part: Any, depth: int) -> bool:
        if depth == len(lengths):
            is_number = type(part) in (int, float)
            return is_number and wanted.least <= part <= wanted.most
        if not isinstance(part, list) or len(part) != lengths[depth]:
            return False
        return all(fits(each, depth + 1) for each in part)

    if fits(value, 0):
        return ''
    nested = ' of lists of '.join(map(str, lengths))
    return f'a list of {nested}, each a number from {wanted.least:g} to {wanted.most:g}'
