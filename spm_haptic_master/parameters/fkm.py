# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of `fkm`, and the limits of the supervision that they describe."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import erfc, exp, inf, pi, radians, sqrt
from statistics import NormalDist

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.axes import GRIPPER_RANGE_SETTING
from spm_haptic_master.parameters.geometry import MECHANISM_SETTINGS, MOUNTING_SETTINGS
from spm_haptic_master.parameters.setting import (
    ANY_COUNT,
    CALIBRATION_SETTING,
    RATE_SETTING,
    SENSORS_SETTING,
    Setting,
    Values,
)

# Sensors that determine an orientation, that check each other by one parity, by two.
THREE_SENSORS = 3
FOUR_SENSORS = 4
FIVE_SENSORS = 5
SAMPLES_AN_HOUR = 3.6e6  # that the rate of false alarms refers to: 1 kHz
# Tests on a sample that share the false alarms: parity alone, parity over the window, four jumps.
TESTS = 6
FULL_RANGE = (
    2.0 * pi - 1e-9
)  # rad; a joint's range from this on is any angle: a turn, but for rounding
# A value of `force.engaged_by`.
BY_TELEOP = 'teleop'

FORCE_SETTINGS = (
    Setting(
        'force.enabled',
        bool,
        'compute motor torques, with the topics of the force feedback',
        default=False,
    ),
    Setting(
        'force.without_drives',
        bool,
        'render without drives of this package: the motor '
        'torques are the effort of crtk/measured_js, for another motor controller',
        default=False,
    ),
    Setting(
        'force.motors',
        int,
        'number of motors: 3 (on th1A, th1B, th1C) or 4 (on th3A, too)',
        default=3,
        allowed=(3, 4),
    ),
    Setting(
        'force.engaged_by',
        str,
        f"what engages force: '{BY_TELEOP}': teleop_state, which "
        "needs a hand on the handle; 'operating_state': ENABLED, for a client that looks "
        'after the hand by itself',
        default=BY_TELEOP,
        allowed=(BY_TELEOP, 'operating_state'),
    ),
    Setting(
        'force.torque_limit',
        float,
        'largest torque asked of the handle, N m',
        default=0.3,
        minimum=0.001,
        maximum=10.0,
    ),
    Setting(
        'force.motor_torque_limit',
        float,
        'largest torque of a motor, N m',
        default=0.5,
        minimum=0.001,
        maximum=10.0,
    ),
    Setting(
        'force.slew',
        float,
        'largest slope of the torque asked of the handle, N m/s',
        default=10.0,
        minimum=0.01,
        maximum=1000.0,
    ),
    Setting(
        'force.ramp',
        float,
        'time over which torque comes up after engaging, s',
        default=0.5,
        minimum=0.01,
        maximum=10.0,
    ),
    Setting(
        'force.damping',
        float,
        'viscous damping added at the handle, N m s/rad',
        default=0.005,
        minimum=0.0,
        maximum=0.1,
    ),
    Setting(
        'force.wrench_timeout',
        float,
        'oldest wrench that is rendered, s',
        default=0.03,
        minimum=0.002,
        maximum=0.2,
    ),
    Setting(
        'force.small_torque',
        float,
        'largest torque of a wrench with which force may begin, N m',
        default=0.05,
        minimum=0.0001,
        maximum=1.0,
    ),
    Setting(
        'force.protection_limit_deg',
        float,
        'largest protection level of an orientation that force relies on, deg',
        default=1.0,
        minimum=0.01,
        maximum=30.0,
    ),
    Setting(
        'force.noise_limit',
        float,
        'largest noise of an encoder over its sigma_deg (unit 1)',
        default=5.0,
        minimum=1.0,
        maximum=100.0,
    ),
    Setting(
        'force.speed_limit',
        float,
        'fastest handle, rad/s: beyond it torque fades out',
        default=6.0,
        minimum=0.1,
        maximum=100.0,
    ),
    Setting(
        'force.sigma_off',
        float,
        'smallest singular value of the motors (unit 1) up to which '
        'three motors render nothing of their weak direction',
        default=0.05,
        minimum=0.01,
        maximum=1.0,
    ),
    Setting(
        'force.sigma_full',
        float,
        'smallest singular value of the motors (unit 1) above which they render all of it',
        default=0.15,
        minimum=0.01,
        maximum=1.0,
    ),
    Setting(
        'force.end_stop_deg',
        float,
        'angle before the end of a leg at which a soft wall begins, deg; 0: no end stop',
        default=5.0,
        minimum=0.0,
        maximum=15.0,
    ),
    Setting(
        'force.lock_stiffness',
        float,
        'stiffness of a locked orientation, N m/rad',
        default=1.0,
        minimum=0.0,
        maximum=2.0,
    ),
    Setting(
        'force.gravity_handle',
        float,
        'mass times offset from the centre of what turns with '
        'the platform, in the platform frame, kg m',
        default=(0.0,) * 3,
        minimum=-1.0,
        maximum=1.0,
        count=3,
    ),
    Setting(
        'force.gravity_proximal',
        float,
        'the same of the proximal links A, B, C: along Z2k and along Z1k x Z2k, kg m',
        default=(0.0,) * 6,
        minimum=-1.0,
        maximum=1.0,
        count=6,
    ),
    Setting(
        'force.gravity_down',
        float,
        'acceleration of gravity in the base frame, m/s^2',
        default=(0.0, 0.0, -9.80665),
        minimum=-20.0,
        maximum=20.0,
        count=3,
    ),
)

# Shortest window of the angular velocity (sample periods): three samples, and their jitter.
VELOCITY_PERIODS = 2.5

# Angle of the gripper that is none (deg).
NO_GRIPPER = 360.0

INTERFACE_SETTINGS = (
    Setting(
        'frame_id',
        str,
        'frame of the base, in which all outputs are unless it is mounted',
        default='spm_base',
    ),
    Setting(
        'mounting.table_frame_id',
        str,
        'frame of the table, in which all outputs are where mounting.base_zxz_deg is not 0',
        default='spm_table',
    ),
    Setting(
        'mounting.platform_frame_id',
        str,
        'frame of the platform, on which the handle is mounted',
        default='spm_platform',
    ),
    Setting(
        'mounting.handle_frame_id',
        str,
        'frame of the handle, whose orientation is published '
        'where mounting.handle_zxz_deg is not 0',
        default='spm_handle',
    ),
    replace(
        RATE_SETTING, description='expected rate of joint samples, Hz; a lower one is a warning'
    ),
    Setting(
        'latency_limit',
        float,
        'largest 99th percentile of the latency from sample to '
        'publication, s; a larger one is a warning',
        default=0.005,
        minimum=1e-5,
        maximum=10.0,
    ),
    Setting(
        'max_age',
        float,
        'largest age of a joint sample, s; an older one is stale and rejected',
        default=0.1,
        minimum=0.001,
        maximum=10.0,
    ),
    Setting(
        'sample_timeout',
        float,
        'time without a joint sample after which that is an error, s',
        default=0.05,
        minimum=0.002,
        maximum=60.0,
    ),
    Setting(
        'velocity_window',
        float,
        'time over which the angular velocity is averaged, s; at '
        f'least {VELOCITY_PERIODS:g} sample periods are used',
        default=0.02,
        minimum=0.002,
        maximum=1.0,
    ),
    Setting(
        'crtk_rate',
        float,
        'rate of measured_cp, setpoint_cp, measured_cv, crtk/measured_js '
        'and gripper/measured_js, Hz; 0: with each orientation',
        default=200.0,
        minimum=0.0,
        maximum=10000.0,
    ),
    Setting(
        'gripper.axis',
        int,
        'axis of the messages on gripper/joy that is the gripper; -1: '
        'none, and gripper.position_deg counts',
        default=-1,
        minimum=-1,
        maximum=63,
    ),
    Setting(
        'gripper.position_deg',
        float,
        'constant angle on gripper/measured_js without an axis, deg, for a client that '
        'needs the topic: a slave whose jaw follows it closes or opens; 360: none, and nothing is '
        'published',
        default=NO_GRIPPER,
        minimum=-180.0,
        maximum=NO_GRIPPER,
    ),
    GRIPPER_RANGE_SETTING,
    CALIBRATION_SETTING,
)

# Values of a list for the fifth and the sixth sensor.
FURTHER = "two further values are for th3B and th3C; without them th3A's is used"

SUPERVISION_SETTINGS = (
    SENSORS_SETTING,
    Setting(
        'sigma_deg',
        float,
        f'standard deviation of th1A, th1B, th1C, th3A, deg; {FURTHER}',
        default=(0.04,) * 4,
        minimum=1e-6,
        maximum=10.0,
        count=ANY_COUNT,
    ),
    Setting(
        'bias_deg',
        float,
        'nominal bias of th1A, th1B, th1C, th3A, deg: bound of what is '
        f'systematic on a healthy, calibrated rig (zeros, links, play); {FURTHER}',
        default=(0.05,) * 4,
        minimum=0.0,
        maximum=10.0,
        count=ANY_COUNT,
    ),
    Setting(
        'parity_bias_deg',
        float,
        'bound of what the systematic errors of all sensors together do to the parity, deg, '
        'where a calibration knows it to be less than what bias_deg allows',
        default=30.0,
        minimum=0.0,
        maximum=30.0,
    ),
    Setting(
        'alert_limit_deg',
        float,
        'largest protection level of an orientation that is '
        'published, deg; where it is lower, more sensors count as unchecked and leave the '
        'level: the bounds on protection_level say what their faults may do',
        default=1.0,
        minimum=0.01,
        maximum=30.0,
        live=True,
    ),
    Setting(
        'unchecked_limit',
        float,
        'longest time that a sensor may go unchecked by the others, s; 0: any',
        default=600.0,
        minimum=0.0,
        maximum=1e6,
    ),
    Setting(
        'start_checked',
        bool,
        'publish no orientation before the others have checked every sensor once',
        default=False,
    ),
    Setting(
        'window',
        float,
        'time over which the parity is averaged (ten samples at least): '
        'the time to alert of a small fault, s',
        default=0.02,
        minimum=0.001,
        maximum=1.0,
    ),
    Setting(
        'skew',
        float,
        'largest difference between the sampling times of two sensors of a sample, s',
        default=0.0,
        minimum=0.0,
        maximum=0.1,
    ),
    Setting(
        'false_alarms_per_hour',
        float,
        'rate of false alarms of the tests of parity and jumps at 1 kHz; sets their threshold',
        default=1e-4,
        minimum=1e-12,
        maximum=3600.0,
    ),
    Setting(
        'joint_min_deg',
        float,
        f'range of th1A, th1B, th1C, th3A, deg; {FURTHER}',
        default=(-180.0,) * 4,
        minimum=-180.0,
        maximum=180.0,
        count=ANY_COUNT,
    ),
    Setting(
        'joint_max_deg',
        float,
        f'range of th1A, th1B, th1C, th3A, deg; {FURTHER}',
        default=(180.0,) * 4,
        minimum=-180.0,
        maximum=180.0,
        count=ANY_COUNT,
    ),
    Setting(
        'joint_speed',
        float,
        'human motion limit of the joint speed, rad/s',
        default=20.0,
        minimum=0.1,
        maximum=1000.0,
    ),
    Setting(
        'joint_acceleration',
        float,
        'human motion limit of the joint acceleration, rad/s^2',
        default=500.0,
        minimum=1.0,
        maximum=1e6,
    ),
    Setting(
        'frozen_samples',
        int,
        'smallest number of equal readings in a row that is a fault, '
        'where the noise of the sensor makes such a run one; 0: never',
        default=20,
        minimum=0,
        maximum=100000,
    ),
    Setting(
        'deviation_limit_deg',
        float,
        'largest total standard deviation of a published orientation, deg',
        default=0.5,
        minimum=0.001,
        maximum=5.0,
    ),
    Setting(
        'start_samples',
        int,
        'number of consistent samples before the first orientation',
        default=5,
        minimum=1,
        maximum=100000,
    ),
    Setting(
        'recovery',
        float,
        'consistency after which a fault is cleared, s',
        default=1.0,
        minimum=0.01,
        maximum=3600.0,
    ),
    Setting(
        'degraded',
        str,
        "'allow': continue without a sensor that is known to be faulty; "
        "'stop': publish nothing; 'auto': 'allow' with six sensors, else 'stop'",
        default='auto',
        allowed=('auto', 'allow', 'stop'),
    ),
    *MECHANISM_SETTINGS,
    *MOUNTING_SETTINGS,
)

# All settings of `fkm` and of `supervise`, which takes its parameter files.
FKM_SETTINGS = (*INTERFACE_SETTINGS, *SUPERVISION_SETTINGS, *FORCE_SETTINGS)


def check_frames(values: Values) -> None:
    """
    Refuse two frames of the mounting with one name.

    Parameters
    ----------
    values : mapping
        Checked values by name.

    Raises
    ------
    SettingError
        Two frames have one name; the second is named.

    """
    seen: dict[str, str] = {}
    for name in (each.name for each in INTERFACE_SETTINGS if each.name.endswith('frame_id')):
        first = seen.setdefault(values[name], name)
        if first != name:
            raise SettingError(name, values[name], f'another frame than that of {first}')


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a healthy device and of a published orientation, of N sensors."""

    false_alarms_per_hour: float  # of the tests of parity and jumps together, 1/h at 1 kHz
    bias: tuple[float, ...]  # rad; systematic error of a healthy rig
    alert_limit: float  # rad; largest protection level of a published orientation
    unchecked_limit: float  # s that a sensor may go unchecked by the others; 0: any
    start_checked: bool  # every sensor has to be checked before the first orientation
    window: float  # s over which small inconsistencies are averaged
    skew: float  # s between the sampling times of two sensors of a set, at most
    joint_min: tuple[float, ...]  # rad
    joint_max: tuple[float, ...]  # rad
    joint_speed: float  # rad/s; human motion limit of a joint, and of the platform's rotation
    joint_acceleration: float  # rad/s^2; human motion limit
    frozen_samples: int  # equal readings in a row that are a fault of a noisy sensor; 0: never
    deviation: float  # rad; largest total standard deviation of a published orientation
    start_samples: int  # consistent samples before the first orientation
    recovery: float  # s of consistency that clear a fault
    fewest_sensors: int  # that go on without one that is known to be faulty
    # rad; bound of the length of that part of all systematic errors that no motion explains.
    parity_bias: float = pi

    def threshold(self, entries: int = 1) -> float:
        """
        Return the limit of the norm of 1 to 3 entries of unit variance, at its false alarms.

        Parameters
        ----------
        entries : int
            Number of independent entries of the parity vector, 1 to 3.

        Returns
        -------
        float
            Limit in standard deviations: of the normal distribution (two-sided), of Rayleigh's, or
            of Maxwell's.

        """
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        if entries == 1:
            return -NormalDist().inv_cdf(share / 2.0)
        low = 0.0
        high = 40.0
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            tail = exp(-0.5 * middle * middle)
            if entries == 3:
                # Maxwell's distribution.
                tail = erfc(middle / sqrt(2.0)) + sqrt(2.0 / pi) * middle * tail
            low, high = (middle, high) if tail > share else (low, middle)
        return high


def limits_from(values: Values) -> Limits:
    """
    Return the Limits that checked settings describe.

    Parameters
    ----------
    values : mapping
        Checked values by name; angles in deg.

    Returns
    -------
    Limits
        Angles in rad, a value for each sensor where lists had four. A joint with a range of a
        whole turn has no limits.

    Raises
    ------
    SettingError
        A joint's range is empty, or a list has another number of values.

    """
    low = _each(values, 'joint_min_deg')
    high = _each(values, 'joint_max_deg')
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise SettingError(
            'joint_min_deg',
            list(values['joint_min_deg']),
            f'less than joint_max_deg ({list(values["joint_max_deg"])})',
        )
    # A joint that may turn all the way round: noise takes a reading past the end of its range.
    ends = [(-inf, inf) if b - a >= FULL_RANGE else (a, b) for a, b in zip(low, high, strict=True)]
    # Five check each other by two parities: two that are wrong do not cancel in both.
    never = values['sensors'] + 1
    fewest = {
        'allow': THREE_SENSORS,
        'auto': FIVE_SENSORS if values['sensors'] > FIVE_SENSORS else never,
        'stop': never,
    }
    same = {field.name: values[field.name] for field in fields(Limits) if field.name in values}
    return Limits(
        **same,
        bias=_each(values, 'bias_deg'),
        parity_bias=radians(values['parity_bias_deg']),
        alert_limit=radians(values['alert_limit_deg']),
        joint_min=tuple(low for low, _ in ends),
        joint_max=tuple(high for _, high in ends),
        deviation=radians(values['deviation_limit_deg']),
        fewest_sensors=fewest[values['degraded']],
    )


def sigma_from(values: Values) -> tuple[float, ...]:
    """
    Return the standard deviations of the sensors, rad, from checked settings.

    Parameters
    ----------
    values : mapping
        Checked values by name; sigma_deg in deg.

    Returns
    -------
    tuple of float
        One for each sensor.

    """
    return _each(values, 'sigma_deg')


def _each(values: Values, name: str) -> tuple[float, ...]:
    """
    Return a setting's value of each sensor, rad; SettingError for another number of them.

    Parameters
    ----------
    values : mapping
        Checked values by name.
    name : str
        Name of a list in deg, with a value for each sensor, or with four, of which the last one is
        then repeated.

    """
    given = values[name]
    sensors = values['sensors']
    if len(given) not in (FOUR_SENSORS, sensors):
        raise SettingError(
            name,
            list(given),
            'a list of ' + ' or '.join(map(str, sorted({FOUR_SENSORS, sensors}))),
        )
    further = given[-1:] * (sensors - len(given))
    return tuple(map(radians, (*given, *further)))
