# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every error of the package; all derive from SpmError."""


class SpmError(Exception):
    """Root of the package's errors: its text names what was wrong, and what was expected."""


class InputError(SpmError, ValueError):
    """A value handed to a function is not what the function takes (shape, range, not finite)."""


class GeometryError(InputError):
    """Link angles that no spherical manipulator can have."""


class UnreachableError(SpmError):
    """No configuration of the manipulator reaches the pose, or closes on the joint angles."""


class SingularityError(SpmError):
    """The answer is undefined here: a working mode's boundary or a parallel singularity."""


class RejectedError(SpmError):
    """
    A joint sample gives no orientation.

    Attributes
    ----------
    reason : str
        In fixed words, so that it can be counted.
    detail : str
        With the values.

    """

    def __init__(self, reason: str, detail: str):
        super().__init__(f'{reason}: {detail}')
        self.reason = reason
        self.detail = detail


class SettingError(InputError):
    """A setting (a ROS parameter, a configuration entry) has a value that it cannot have."""

    def __init__(self, name: str, value: object, expected: str):
        super().__init__(f"parameter '{name}' is {value!r}; expected {expected}")
        self.name = name
        self.value = value
        self.expected = expected


class ReplayError(SpmError):
    """A recording cannot be played: unreadable, without encoder frames, time running backwards."""


class SourceEnded(SpmError):
    """The source has no more samples: a recording that is not looped has been played to its end."""


class CalibrationError(SpmError):
    """A recording that no calibration can rest on: the device moved, a sensor is noisy or wraps."""
