# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The errors of the package; all derive from SpmError."""

# Longest quoted value (characters).
LONGEST = 160


class SpmError(Exception):
    """Root of the package's errors; the text quotes the wrong value and the expected one."""

    def __reduce__(self) -> tuple[type, tuple[object, ...]]:
        """Return type and arguments that rebuild the error in another process."""
        return type(self), tuple(vars(self).values()) or self.args


class InputError(SpmError, ValueError):
    """
    An argument of a function is invalid: its shape, its range, or not finite.

    Its text is one line: characters that cannot be printed are escaped.
    """

    def __init__(self, text: str) -> None:
        super().__init__(
            ''.join(
                each if each.isprintable() else each.encode('unicode_escape').decode()
                for each in text
            )
        )


class GeometryError(InputError):
    """Link angles or axes with which no spherical manipulator can be built."""


class UnreachableError(SpmError):
    """No configuration of the manipulator reaches the pose, or closes with the joint angles."""


class SingularityError(SpmError):
    """The result is undefined at a working mode's boundary or at a parallel singularity."""


class AmbiguousError(SingularityError):
    """Two orientations explain the readings equally well, and no earlier one selects."""


class RejectedError(SpmError):
    """
    A joint sample is rejected: no orientation is published for it.

    Attributes
    ----------
    reason : str
        Reason in fixed words, so that rejections can be counted by reason.
    detail : str
        Explanation with the values.

    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f'{reason}: {detail}')
        self.reason = reason
        self.detail = detail


class SettingError(InputError):
    """
    A setting (a ROS parameter, an entry of a configuration file) has an invalid value.

    Attributes
    ----------
    name : str
        Name of the setting.
    value : object
        Invalid value; None where none is given.
    expected : str
        Description of the valid values.

    """

    def __init__(self, name: str, value: object, expected: str) -> None:
        shown = 'not set' if value is None else repr(value)
        super().__init__(f"parameter '{name}' is {shown}; expected {expected}")
        self.name = name
        self.value = value
        self.expected = expected


class ReplayError(SpmError):
    """A recording cannot be replayed: unreadable, no encoder frames, or stamps that decrease."""


class RivalError(SpmError):
    """Another process publishes on a topic that belongs to one."""


class SourceEnded(SpmError):
    """The source has no more samples: a recording without loop has been replayed to its end."""


class CalibrationError(SpmError):
    """A recording is unfit for calibration: the device moved, a sensor is noisy or wraps."""


class SetupError(SpmError):
    """An encoder cannot be set up: it does not answer, refuses a value, or does not keep it."""


def quoted(value: object) -> str:
    """Return the representation of any value on one line, shortened to `LONGEST` characters."""
    try:
        text = ' '.join(repr(value).split())
    except Exception:  # a foreign type may raise anything
        text = f'a value of type {type(value).__name__}'
    if len(text) <= LONGEST:
        return text
    return f'{text[: LONGEST - 4]} ...'
