# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the mechanism, nominal or as built, and of its mounting, shared by all nodes."""

from __future__ import annotations

import hashlib
from math import acos, degrees, radians, tau

from spm_haptic_master.exceptions import GeometryError, SettingError
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.geometry import NOMINAL_BASE_AXES, PAPER_GEOMETRY
from spm_haptic_master.kinematics.joints import LEG_NAMES
from spm_haptic_master.kinematics.mounting import Mounting
from spm_haptic_master.kinematics.rotations import zxz_quaternion
from spm_haptic_master.kinematics.workspace import workspace_pose
from spm_haptic_master.parameters.setting import Setting, Values

NOMINAL_SETTINGS = tuple(
    Setting(
        f'geometry.{name}_deg',
        float,
        f'{part}, deg',
        default=degrees(getattr(PAPER_GEOMETRY, name)),
        minimum=0.1,
        maximum=179.9,
    )
    for name, part in (
        ('alpha', 'angle of the proximal link'),
        ('beta', 'angle of the distal link'),
        ('gamma', 'angle between the platform axis and each Z3k'),
    )
)

NOMINAL_BASE = tuple(component for axis in NOMINAL_BASE_AXES for component in axis)
# Settings of the mechanism as built; without them it is nominal.
BUILT_SETTINGS = (
    Setting(
        'geometry.proximal_deg',
        float,
        'as built: angles of the proximal links of the legs A, B, C, deg; 0: geometry.alpha_deg',
        default=(0.0,) * 3,
        minimum=0.0,
        maximum=179.9,
        count=3,
    ),
    Setting(
        'geometry.distal_deg',
        float,
        'as built: angles of the distal links of the legs A, B, C, deg; 0: geometry.beta_deg',
        default=(0.0,) * 3,
        minimum=0.0,
        maximum=179.9,
        count=3,
    ),
    Setting(
        'geometry.base_axes',
        float,
        'as built: unit vectors Z1A, Z1B, Z1C in the base frame, '
        'x y z of each; by default the nominal ones',
        default=NOMINAL_BASE,
        count=9,
    ),
    Setting(
        'geometry.platform_axes',
        float,
        'as built: unit vectors Z3A, Z3B, Z3C in the '
        'platform frame, x y z of each; all 0: those of geometry.gamma_deg',
        default=(0.0,) * 9,
        count=9,
    ),
)
GEOMETRY_SETTINGS = (*NOMINAL_SETTINGS, *BUILT_SETTINGS)
WORKING_MODE_SETTING = Setting(
    'working_mode',
    int,
    'sign of Z1k . (Z2k x Z3k) of the legs A, B, C',
    default=(1, 1, 1),
    allowed=(1, -1),
    count=3,
)
MECHANISM_SETTINGS = (*GEOMETRY_SETTINGS, WORKING_MODE_SETTING)

# Settings of the rotations of the mounting; 0 each: none.
MOUNTING_SETTINGS = tuple(
    Setting(
        f'mounting.{part}_zxz_deg',
        float,
        f'psi, theta, phi (ZXZ) of {rotation}, deg; 0 each: none',
        default=(0.0,) * 3,
        minimum=-360.0,
        maximum=360.0,
        count=3,
    )
    for part, rotation in (
        ('base', 'R_table_base, the base on its table'),
        ('handle', 'R_platform_handle, the handle on the platform'),
    )
)

# Orientation at the workspace's centre.
CENTRE = workspace_pose(0.0, 0.0, 0.0)
CHECKSUM_DIGITS = 8


def geometry_from(values: Values) -> Geometry:
    """
    Return the mechanism of checked settings.

    Parameters
    ----------
    values : mapping
        Values of GEOMETRY_SETTINGS by name; angles in deg.

    Returns
    -------
    Geometry
        Nominal, or as built where a setting of BUILT_SETTINGS is given; angles in rad.

    Raises
    ------
    SettingError
        The axes are not those of a mechanism, or it cannot be assembled at the workspace's centre.
        The setting named is the first whose default would cure that.

    """
    geometry = _built(values)
    if gap := _gap(geometry):
        given = [each for each in GEOMETRY_SETTINGS if values[each.name] != each.default]
        # The first setting with whose default it can be assembled, otherwise the last one.
        name = next(
            (each.name for each in given if not _gap(_built({**values, each.name: each.default}))),
            given[-1].name,
        )
        value = values[name]
        raise SettingError(
            name,
            list(value) if isinstance(value, tuple) else value,
            f"a mechanism that can be assembled at the workspace's centre: there {gap}",
        )
    return geometry


def _built(values: Values) -> Geometry:
    """
    Return the mechanism as built; the nominal one where nothing else is given.

    Raises
    ------
    SettingError
        Axes are not three unit vectors of a mechanism.

    """
    nominal = Geometry(*(radians(values[setting.name]) for setting in NOMINAL_SETTINGS))
    proximal, distal, base, platform = (values[setting.name] for setting in BUILT_SETTINGS)
    if not any((*proximal, *distal, *platform)) and base == NOMINAL_BASE:
        return nominal
    try:
        return Geometry.from_axes(
            _rows(base),
            _rows(platform) if any(platform) else nominal.platform_axes,
            _links(proximal, nominal.alpha),
            _links(distal, nominal.beta),
        )
    except GeometryError as error:
        name = BUILT_SETTINGS[2 if str(error).startswith('base_axes') else 3].name
        raise SettingError(
            name, list(values[name]), f'the unit vectors of three axes ({error})'
        ) from error


def _rows(numbers: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Return numbers in rows of three."""
    return [numbers[start : start + 3] for start in range(0, len(numbers), 3)]


def _links(angles_deg: tuple[float, ...], nominal: float) -> list[float]:
    """Return link angles, rad: those given, and the nominal one for 0."""
    return [radians(angle) if angle else nominal for angle in angles_deg]


def _gap(geometry: Geometry) -> str:
    """
    Return why the first leg does not close at the workspace's centre; empty if all close.

    Returns
    -------
    str
        The leg, the angle between its axes Z1k and Z3k and the angles that its links can span,
        deg.

    """
    for leg, name in enumerate(LEG_NAMES):
        alpha = geometry.alphas[leg]
        beta = geometry.betas[leg]
        cosine = float(CENTRE @ geometry.platform_axes[leg] @ geometry.base_axes[leg])
        apart = acos(max(-1.0, min(1.0, cosine)))
        least = abs(alpha - beta)
        most = min(alpha + beta, tau - alpha - beta)
        if apart < least or apart > most:
            return (
                f'Z1{name} and Z3{name} are {degrees(apart):.2f} deg apart, and links of '
                f'{degrees(alpha):g} and {degrees(beta):g} deg span {degrees(least):.2f} to '
                f'{degrees(most):.2f} deg'
            )
    return ''


def mounting_from(values: Values) -> Mounting | None:
    """
    Return the Mounting of checked settings, None where nothing is mounted with a rotation.

    Parameters
    ----------
    values : mapping
        Values of MOUNTING_SETTINGS by name: psi, theta, phi (ZXZ), deg.

    Returns
    -------
    Mounting or None
        Quaternions of R_table_base and R_platform_handle.

    """
    base, handle = (values[setting.name] for setting in MOUNTING_SETTINGS)
    if not any((*base, *handle)):
        return None
    return Mounting(*(zxz_quaternion(*map(radians, angles)) for angles in (base, handle)))


def mechanism_checksum(values: Values) -> str:
    """
    Return eight hex digits: equal for equal mechanisms (to 1e-9 rad) and working modes.

    Two nodes with the same checksum have the same mechanism, whether it is given as nominal or as
    built.

    Parameters
    ----------
    values : mapping
        Checked values of MECHANISM_SETTINGS by name.

    Returns
    -------
    str
        CHECKSUM_DIGITS hexadecimal digits.

    Raises
    ------
    SettingError
        As of `geometry_from`.

    """
    geometry = geometry_from(values)
    numbers = [
        *geometry.alphas,
        *geometry.betas,
        *(
            component
            for axes in (geometry.base_axes, geometry.platform_axes)
            for axis in axes
            for component in axis
        ),
    ]
    # Adding 0 makes -0 a 0.
    text = ' '.join(f'{round(number, 9) + 0.0:.9f}' for number in numbers)
    mode = ' '.join(map(str, values[WORKING_MODE_SETTING.name]))
    return hashlib.sha256(f'{text} {mode}'.encode()).hexdigest()[:CHECKSUM_DIGITS]
