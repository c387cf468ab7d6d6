"""Every error of the package; all derive from SpmError."""


class SpmError(Exception):
    """Root of the package's errors: its text names what was wrong, the value and what was expected."""


class InputError(SpmError, ValueError):
    """A value handed to a function is not what the function takes (shape, range, not finite)."""


class GeometryError(InputError):
    """Link angles that no spherical manipulator can have."""


class UnreachableError(SpmError):
    """No configuration of the manipulator reaches the pose, or closes on the joint angles."""


class SingularityError(SpmError):
    """The answer is undefined here: a working mode's boundary or a parallel singularity."""
