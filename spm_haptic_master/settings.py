# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a setting may be: type, range, allowed values; checked once, where it enters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from spm_haptic_master.exceptions import SettingError

Scalar = bool | int | float | str
# Checked settings by name: each value has its setting's type.
Values = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Setting:
    """
    One named setting, independent of where its value comes from.

    Parameters
    ----------
    name : str
        Dotted name, as the ROS parameter is called.
    kind : type
        bool, int, float or str; with `count`, the type of each element.
    description : str
        One line for a rig's engineer, with the unit.
    default : optional
        Value when none is given; None where a configuration file has to give it.
    minimum, maximum : optional
        Inclusive bounds of a number (of each element).
    allowed : tuple, optional
        The only values possible.
    count : int, optional
        The setting is a list of that many elements.
    live : bool
        It may be changed while the node runs.

    """

    name: str
    kind: type
    description: str
    default: Scalar | tuple[Scalar, ...] | None = None
    minimum: float | None = None
    maximum: float | None = None
    allowed: tuple[Scalar, ...] = ()
    count: int | None = None
    live: bool = False

    @property
    def expected(self) -> str:
        """Tell in words what the setting takes."""
        word = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'a text'}
        text = word[self.kind]
        if self.allowed:
            text = 'one of ' + ', '.join(str(value) for value in self.allowed)
        elif self.minimum is not None and self.maximum is not None:
            text += f' from {self.minimum:g} to {self.maximum:g}'
        elif self.minimum is not None:
            text += f' of at least {self.minimum:g}'
        elif self.maximum is not None:
            text += f' of at most {self.maximum:g}'
        return text if self.count is None else f'a list of {self.count}, each {text}'

    def check(self, value: Any) -> Scalar | tuple[Scalar, ...]:
        """
        Return `value` as the setting's type (an integer where a float is meant becomes one).

        Raises
        ------
        SettingError
            Naming the setting, the value and what was expected.

        """
        if self.count is None:
            return self._check_one(value, value)
        if isinstance(value, str | bytes) or not hasattr(value, '__len__') \
                or len(value) != self.count:
            raise SettingError(self.name, value, self.expected)
        return tuple(self._check_one(element, value) for element in value)

    def _check_one(self, element: Any, value: Any) -> Scalar:
        if self.kind is float and isinstance(element, int) and not isinstance(element, bool):
            element = float(element)
        wrong = type(element) is not self.kind \
            or (self.allowed and element not in self.allowed) \
            or (self.kind is float and not math.isfinite(element)) \
            or (self.minimum is not None and element < self.minimum) \
            or (self.maximum is not None and element > self.maximum)
        if wrong:
            raise SettingError(
                self.name, list(value) if self.count else value, self.expected)
        return element


def complete(settings: tuple[Setting, ...], values: Values) -> dict[str, Any]:
    """
    Check a value for each setting, its default where `values` has none.

    Raises
    ------
    SettingError
        For a wrong value, a missing one, or a name that no setting has.

    """
    known = {setting.name for setting in settings}
    for name, value in values.items():
        if name not in known:
            raise SettingError(name, value, 'a known name: ' + ', '.join(sorted(known)))
    return {s.name: s.check(values.get(s.name, s.default)) for s in settings}
