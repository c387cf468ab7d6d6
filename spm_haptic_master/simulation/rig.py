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
from typing import Any

from spm_haptic_master.exceptions import GeometryError, InputError, quoted, SettingError
from spm_haptic_master.kinematics import Geometry, in_usual_frames
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values

# Cosine and sine coefficient of a harmonic.
Harmonic = tuple[float, float]
# Length of a list of all sensors.
ALL = 0
# Keys of the mechanism: lengths of the nested lists, least and largest number; the range of a link
# angle is that of the geometry's parameters.
MECHANISM = {
    'alpha_deg': ((3,), 0.1, 179.9),
    'beta_deg': ((3,), 0.1, 179.9),
    'base_axes': ((3, 3), -1.0, 1.0),
    'platform_axes': ((3, 3), -1.0, 1.0),
}
# Keys of the sensors' errors: fields of SensorErrors, and numbers (none beyond these ranges is
# meant, and within them an encoder's reading grows with the angle).
ERRORS = {
    'eccentricity_deg_cos_sin': ('first_harmonic', ((ALL, 2), -10.0, 10.0)),
    'second_harmonic_deg': ('second_harmonic', ((ALL, 2), -10.0, 10.0)),
    'play_deg': ('play', ((ALL,), 0.0, 10.0)),
    'noise_deg': ('noise', ((ALL,), 0.0, 10.0)),
    'resolution_deg': ('resolution', ((ALL,), 0.0, 10.0)),
    'delay': ('delay', ((ALL,), 0.0, 0.1)),
}
# All keys; of the encoders' scale nothing is read: the parameters `encoders.*` set it.
KEYS = MECHANISM | {key: kind for key, (_, kind) in ERRORS.items()}
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
        return any(any(each.first_harmonic + each.second_harmonic) for each in self.sensors)


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


def perfect_rig(geometry: Geometry, noise: float, sensors: int = len(JOINT_NAMES)) -> Rig:
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

    def axes(nominal_axes: Sequence[Sequence[float]]) -> list[list[float]]:
        moved = [
            [each + tolerances.axes * gauss(0.0, 1.0) for each in axis] for axis in nominal_axes
        ]
        return [[each / hypot(*axis) for each in axis] for axis in moved]

    def harmonic(deviation: float) -> Harmonic:
        return deviation * gauss(0.0, 1.0), deviation * gauss(0.0, 1.0)

    alphas, betas = (
        [angle + tolerances.links * gauss(0.0, 1.0) for angle in each]
        for each in (nominal.alphas, nominal.betas)
    )
    base = axes(nominal.base_axes)
    platform = axes(nominal.platform_axes)
    built = in_usual_frames(Geometry.from_axes(base, platform, alphas, betas), nominal)
    return Rig(
        built,
        tuple(
            SensorErrors(
                first_harmonic=harmonic(tolerances.first_harmonic),
                second_harmonic=harmonic(tolerances.second_harmonic),
                noise=noise,
            )
            for _ in range(sensors)
        ),
    )


def _without_doubles(pairs: list[tuple[str, object]]) -> dict[str, object]:
    """Return an object of a JSON file; ValueError for a key that is given twice."""
    content = dict(pairs)
    names = [name for name, _ in pairs]
    for name in content:
        if names.count(name) > 1:
            raise ValueError(f"key '{name}' is given twice")
    return content


def _mechanism(path: str | Path, content: dict[str, Any], drawn: Geometry) -> Geometry:
    """Return the mechanism of a rig's file; what it lacks is as drawn."""
    alphas, betas = (
        [radians(each) for each in content[key]] if key in content else list(nominal)
        for key, nominal in (('alpha_deg', drawn.alphas), ('beta_deg', drawn.betas))
    )
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
    path: str | Path, drawn: Geometry, noise: float, sensors: int = len(JOINT_NAMES)
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
    given = {
        name: [_converted(key, radians, each) for each in content[key]]
        for key, (name, _) in ERRORS.items()
        if key in content
    }
    return Rig(
        mechanism,
        tuple(
            SensorErrors(
                **{'noise': noise} | {name: values[index] for name, values in given.items()}
            )
            for index in range(sensors)
        ),
    )


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
    except (OSError, ValueError) as error:
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
        **{
            key: [_converted(key, degrees, getattr(each, name)) for each in rig.sensors]
            for key, (name, _) in ERRORS.items()
        },
    }
    return (
        '{\n'
        + ',\n'.join(f' {json.dumps(key)}: {json.dumps(value)}' for key, value in content.items())
        + '\n}\n'
    )


def _converted(key: str, convert: Callable[[float], float], value: Any) -> Any:
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
        return random_rig(
            seed,
            Tolerances(
                *map(radians, (*values['sim.tolerance_deg'], *values['sim.harmonics_deg']))
            ),
            geometry,
            noise,
            sensors,
        )
    return perfect_rig(geometry, noise, sensors)


def _complaint(key: str, value: Any, sensors: int) -> str:
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
    shape, least, most = KEYS[key]
    lengths = [length or sensors for length in shape]

    def fits(part: Any, depth: int) -> bool:
        if depth == len(lengths):
            return type(part) in (int, float) and least <= part <= most
        return (
            isinstance(part, list)
            and len(part) == lengths[depth]
            and all(fits(each, depth + 1) for each in part)
        )

    if fits(value, 0):
        return ''
    return (
        f'a list of {" of lists of ".join(map(str, lengths))}, each '
        f'a number from {least:g} to {most:g}'
    )
