# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The tele-operation that checked settings describe."""

from __future__ import annotations

from math import inf, radians

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.rotations import zxz_quaternion
from spm_haptic_master.kinematics.vectors import scaled
from spm_haptic_master.parameters.nodes import ANY_OFFSET, NO_TROCAR
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.teleoperation.command_limits import CommandLimits
from spm_haptic_master.teleoperation.conditions import Conditions
from spm_haptic_master.teleoperation.engaging import Teleoperation
from spm_haptic_master.teleoperation.limited_depth import DepthLimits
from spm_haptic_master.teleoperation.remote_centre import RemoteCentreSettings
from spm_haptic_master.teleoperation.vectors import FloatQuaternion, FloatVector, norm

# Periods of the command that it makes up for in one step, after a pause.
LONGEST_STEP = 2.0
# Least scale of the insertion (unit 1): below it a slide of 0.2 m moves the tip by 10 mm.
LEAST_SCALE = 0.05
# Largest deviation of an axis's length from 1 (unit 1): three decimals of each component.
AXIS_TOLERANCE = 0.01


def registration_from(values: Values) -> FloatQuaternion:
    """
    Return the unit quaternion x, y, z, w of R_slave_master from checked settings.

    Parameters
    ----------
    values : mapping
        Checked settings of `teleop`: ZXZ angles, deg.

    """
    psi, theta, phi = map(radians, values['teleop.registration_zxz_deg'])
    return zxz_quaternion(psi, theta, phi)


def trocar_from(values: Values, name: str = 'teleop.trocar') -> FloatVector | None:
    """
    Read the setting of a trocar.

    Parameters
    ----------
    values
        Checked settings.
    name
        Name of the setting.

    Returns
    -------
    tuple of float, or None
        x, y, z in the slave's base frame, m; None without a trocar.

    Raises
    ------
    SettingError
        Another number of values than one, which is 0, or three.

    """
    given = values[name]
    if given == NO_TROCAR:
        return None
    if len(given) != 3:
        raise SettingError(
            name=name,
            value=list(given),
            expected='three numbers x, y, z (m), or 0.0 for none',
        )
    x, y, z = given
    return x, y, z


def command_period(values: Values) -> float:
    """
    Return the time from one command to the next, s.

    Parameters
    ----------
    values : mapping
        Checked settings of `teleop`. The rate of the commands is at most that of the samples; 0:
        the same.

    """
    sample_rate = values['rate']
    rate = min(values['teleop.command_rate'], sample_rate)
    return float(1.0 / (rate or sample_rate))


def make_teleoperation(values: Values) -> Teleoperation:
    """
    Make the tele-operation that settings describe.

    Parameters
    ----------
    values
        Checked settings of `teleop`.

    Returns
    -------
    Teleoperation
        Disengaged, with the trocar if one is set.

    Raises
    ------
    SettingError
        Two settings contradict each other.

    """
    trocar = trocar_from(values)
    machine = Teleoperation(_conditions(values), _limits(values))
    if trocar is not None:
        machine.take_trocar(trocar)
    return machine


def _limits(values: Values) -> CommandLimits:
    """Return the limits of the commanded rotation; SettingError for an alignment beyond them."""
    speed = values['teleop.speed_limit']
    if values['teleop.align_speed'] > speed:
        raise SettingError(
            name='teleop.align_speed',
            value=values['teleop.align_speed'],
            expected=f'at most teleop.speed_limit ({speed:g})',
        )
    return CommandLimits(
        speed=speed,
        acceleration=values['teleop.acceleration_limit'],
        jump=radians(values['teleop.jump_limit_deg']),
        slews=values['teleop.limit_action'] == 'slew',
        longest_step=LONGEST_STEP * command_period(values),
    )


def _conditions(values: Values) -> Conditions:
    """Return when the slave may follow, in SI units; what is set to 'any' is infinite."""
    align_speed = 0.0
    if values['teleop.alignment'] == 'absolute':
        align_speed = values['teleop.align_speed']
    tolerance = inf
    if values['teleop.alignment_tolerance_deg'] != ANY_OFFSET:
        tolerance = radians(values['teleop.alignment_tolerance_deg'])
    return Conditions(
        registration=registration_from(values),
        align_speed=align_speed,
        tolerance=tolerance,
        enable_timeout=values['teleop.enable_timeout'],
        orientation_timeout=values['teleop.orientation_timeout'],
        slave_timeout=values['teleop.slave_timeout'],
        presence_timeout=values['teleop.presence_timeout'] or inf,
        protection_limit=_limit_rad(values['teleop.protection_limit_deg']),
        tracking_limit=_limit_rad(values['teleop.tracking_limit_deg']),
        tip_tracking_limit=values['teleop.tip_tracking_limit'] or inf,
        command_rate=values['teleop.command_rate'],
        sample_rate=values['rate'],
        requires_trocar=values['teleop.requires_trocar'],
        centre=_centre(values),
    )


def _limit_rad(limit_deg: float) -> float:
    """Return a limit in rad; inf where it is 0 deg, which means no limit."""
    if limit_deg:
        return radians(limit_deg)
    return inf


def _centre(values: Values) -> RemoteCentreSettings:
    """Return how the slave pivots about its trocar; SettingError for a scale or range of none."""
    scale = values['teleop.insertion_scale']
    if 0.0 < scale < LEAST_SCALE:
        raise SettingError(
            name='teleop.insertion_scale',
            value=scale,
            expected=f'at least {LEAST_SCALE:g}, or 0 for a depth that stays',
        )
    shortest, deepest = values['teleop.depth_range']
    if shortest >= deepest:
        raise SettingError(
            name='teleop.depth_range',
            value=[shortest, deepest],
            expected='the smaller depth before the larger one',
        )
    return RemoteCentreSettings(
        scale=scale,
        depth=DepthLimits(
            shortest=shortest,
            deepest=deepest,
            speed=values['teleop.insertion_speed_limit'],
            acceleration=values['teleop.insertion_acceleration_limit'],
            slews=values['teleop.limit_action'] == 'slew',
            longest_step=LONGEST_STEP * command_period(values),
        ),
        largest_tilt=_limit_rad(values['teleop.tilt_limit_deg']),
        shaft=_shaft(values),
    )


def _shaft(values: Values) -> FloatVector | None:
    """Return the shaft in the tool's frame, unit vector; None where it is not known."""
    x, y, z = values['teleop.shaft_axis']
    length = norm((x, y, z))
    if length == 0.0:
        return None
    if abs(length - 1.0) > AXIS_TOLERANCE:
        raise SettingError(
            name='teleop.shaft_axis',
            value=[x, y, z],
            expected='a vector of length 1, or zeros where it is not known',
        )
    return scaled(1.0 / length, (x, y, z))
