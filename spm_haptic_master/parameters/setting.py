# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A setting: type, range, allowed values, checked once, at the boundary; and shared settings."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
import math
from typing import Any

from spm_haptic_master.exceptions import SettingError

# Count of a list that may have any number of elements but none: ROS gives an empty list no type.
ANY_COUNT = 0

Scalar = bool | int | float | str
# The types of values, in an error message.
WORDS: Mapping[type, str] = {
    bool: 'true or false',
    int: 'an integer',
    float: 'a number',
    str: 'a text',
}
# Values of settings by name, checked: each has its setting's type.
Values = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Setting:
    """
    A named setting, independent of the source of its value.

    The tables of settings are in `parameters/nodes.py`, `fkm.py`, `encoders.py` and `geometry.py`;
    a node declares them, a program checks its command line by them, and the pages of the
    parameters are generated from them.
    """

    name: str  # dotted, as of the ROS parameter
    kind: type[Any]  # of the value, or of each element: bool, int, float or str
    description: str  # meaning and unit in one line
    default: Scalar | tuple[Scalar, ...] | None = None  # None if there is no default
    minimum: float | None = None  # inclusive, of each element
    maximum: float | None = None
    allowed: tuple[Scalar, ...] = ()  # empty: all within the bounds
    count: int | None = None  # elements of a list, or `ANY_COUNT`; None for a single value
    live: bool = False  # whether it may be changed while the node runs
    blank: bool = False  # whether a text may be empty
    per_sensor: bool = False  # whether a list has one element for each sensor
    remedy: str = ''  # what to do where no value is given and there is no default

    @property
    def expected(self) -> str:
        """Return a description of the valid values, for an error message."""
        element = self._expected_element()
        if self.count is None:
            return element
        text = f'a list of {self.count or "one or more"}, each {element}'
        return f'{text} (sensors: {self.count})' if self.per_sensor else text

    def _expected_element(self) -> str:
        """Return a description of a valid value, or of each element of a list."""
        if self.allowed:
            return 'one of ' + ', '.join(str(value) for value in self.allowed)
        if self.kind is str and not self.blank:
            return f'{WORDS[str]} that is not empty'
        return WORDS[self.kind] + self._expected_range()

    def _expected_range(self) -> str:
        """Return the bounds in words; empty without one."""
        if self.minimum is not None and self.maximum is not None:
            return f' from {self.minimum:g} to {self.maximum:g}'
        if self.minimum is not None:
            return f' of at least {self.minimum:g}'
        if self.maximum is not None:
            return f' of at most {self.maximum:g}'
        return ''

    def check(self, value: Any) -> Scalar | tuple[Scalar, ...]:
        """
        Check a given value.

        Parameters
        ----------
        value
            The value, of any type; None where nothing was given and there is no default.

        Returns
        -------
        bool, int, float, str or tuple of these
            The value in the setting's type: 5 as 5.0 for a float.

        Raises
        ------
        SettingError
            The value is missing, of another type, out of range or not allowed, or a list is empty
            or has another number of elements.

        """
        if value is None:
            raise SettingError(self.name, None, self.remedy or self.expected)
        if self.count is None:
            return self._check_one(value, value)
        is_list = hasattr(value, '__len__') and not isinstance(value, str | bytes | Set | Mapping)
        if not is_list or not len(value) or len(value) != (self.count or len(value)):
            raise SettingError(self.name, value, self.expected)
        return tuple(self._check_one(element, value) for element in value)

    def _check_one(self, element: Any, value: Any) -> Scalar:
        """
        Return `element` of `value` in the setting's type.

        Parameters
        ----------
        element
            A single value, or an element of a list; a whole number becomes a float if the setting
            is one.
        value
            The whole value, for the error message.

        Raises
        ------
        SettingError
            The element is not valid.

        """
        if self.kind is float and isinstance(element, int) and not isinstance(element, bool):
            try:
                element = float(element)
            except OverflowError:
                element = math.inf
        if not self._is_valid(element):
            raise SettingError(
                self.name, value if self.count is None else list(value), self.expected
            )
        checked: Scalar = element
        return checked

    def _is_valid(self, element: Any) -> bool:
        """Return whether an element has the setting's type and is among the valid values."""
        if type(element) is not self.kind:
            return False
        if self.allowed and element not in self.allowed:
            return False
        if self.kind is str:
            return self.blank or bool(element.strip())
        if self.kind is float and not math.isfinite(element):
            return False
        return self._is_in_range(element)

    def _is_in_range(self, element: Any) -> bool:
        """Return whether a number is within the bounds."""
        if self.minimum is not None and element < self.minimum:
            return False
        return self.maximum is None or bool(element <= self.maximum)


# Names of settings that this package had, and what is expected instead of them.
REMOVED = {
    'solver': 'no such parameter: fkm estimates from all sensors; the other models of the paper '
    'are functions of spm_haptic_master.kinematics (forward_theta3a, track_mode)'
}


def complete(settings: tuple[Setting, ...], values: Values) -> dict[str, Any]:
    """
    Return a checked value of each setting: the given one, or its default.

    Parameters
    ----------
    settings : tuple of Setting
        The known settings.
    values : mapping
        Given values by name.

    Returns
    -------
    dict
        The values by name, each in its setting's type.

    Raises
    ------
    SettingError
        A name is unknown, or a value is invalid.

    """
    known = {setting.name for setting in settings}
    for name, value in values.items():
        if name in REMOVED:
            raise SettingError(name, value, REMOVED[name])
        if name not in known:
            raise SettingError(name, value, 'a known name: ' + ', '.join(sorted(known)))
    return {s.name: s.check(values.get(s.name, s.default)) for s in settings}


# Nominal rate of the sets, and of SYNC produced by the driver.
RATE_SETTING = Setting(
    'rate',
    float,
    'rate of the sets of joint angles, Hz',
    default=1000.0,
    minimum=1.0,
    maximum=10000.0,
)

# Number of sensors, in every node that needs to know.
SENSORS_SETTING = Setting(
    'sensors',
    int,
    'number of sensors: 4 (th1A, th1B, th1C, th3A), 5 (these and th3B) or 6 '
    '(these, th3B and th3C)',
    default=4,
    allowed=(4, 5, 6),
)

# Name of the calibration, in every node that takes a part of it.
CALIBRATION_SETTING = Setting(
    'calibration',
    str,
    'name of the calibration that the zero counts, sigma_deg and bias_deg '
    'are from: calibrate writes its date; driver and fkm need the same',
    default='',
    blank=True,
)

# Frame of the driver's samples, which CRTK clients expect to be there.
JOINTS_FRAME_SETTING = Setting(
    'measured_js.frame_id', str, 'frame_id of measured_js', default='spm_base'
)
