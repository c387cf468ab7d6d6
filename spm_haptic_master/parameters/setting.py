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
# Values of settings by name, checked: each has its setting's type.
Values = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Setting:
    """A named setting, independent of the source of its value."""

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
        word = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'a text'}
        text = word[self.kind]
        if self.allowed:
            text = 'one of ' + ', '.join(str(value) for value in self.allowed)
        elif self.kind is str and not self.blank:
            text += ' that is not empty'
        elif self.minimum is not None and self.maximum is not None:
            text += f' from {self.minimum:g} to {self.maximum:g}'
        elif self.minimum is not None:
            text += f' of at least {self.minimum:g}'
        elif self.maximum is not None:
            text += f' of at most {self.maximum:g}'
        if self.count is None:
            return text
        text = f'a list of {self.count or "one or more"}, each {text}'
        return f'{text} (sensors: {self.count})' if self.per_sensor else text

    def check(self, value: Any) -> Scalar | tuple[Scalar, ...]:
        """Return `value` in the setting's type (5 as 5.0 for a float); SettingError if invalid."""
        if value is None:
            raise SettingError(self.name, None, self.remedy or self.expected)
        if self.count is None:
            return self._check_one(value, value)
        if (
            isinstance(value, str | bytes | Set | Mapping)
            or not hasattr(value, '__len__')
            or not len(value)
            or (self.count and len(value) != self.count)
        ):
            raise SettingError(self.name, value, self.expected)
        return tuple(self._check_one(element, value) for element in value)

    def _check_one(self, element: Any, value: Any) -> Scalar:
        """Return `element` of `value` in the setting's type."""
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
        return type(element) is self.kind and not (
            (self.allowed and element not in self.allowed)
            or (self.kind is str and not self.blank and not element.strip())
            or (self.kind is float and not math.isfinite(element))
            or (self.minimum is not None and element < self.minimum)
            or (self.maximum is not None and element > self.maximum)
        )


def complete(settings: tuple[Setting, ...], values: Values) -> dict[str, Any]:
    """Return the checked values, or defaults, by name; SettingError also for an unknown name."""
    known = {setting.name for setting in settings}
    for name, value in values.items():
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
