"""From one joint sample after another to orientations that may be trusted, or a reason why not."""

from __future__ import annotations

from math import isfinite, sqrt

from spm_haptic_master.exceptions import RejectedError, SpmError
from spm_haptic_master.kinematics.assembly_modes import track_mode
from spm_haptic_master.kinematics.estimation import estimate_sample, SampleEstimate
from spm_haptic_master.kinematics.forward import theta3a_quaternion
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.rotations import matrix_from_quaternion, quaternion_from_matrix

METHODS = ('estimate', 'theta3a', 'classic')
"""
The forward models to choose from.

'estimate' is the maximum-likelihood orientation of all four sensors; 'theta3a' the paper's Case 2
(eqs. 15, 16); 'classic' the three active joints alone (eqs. 1 to 7), with the assembly mode nearest
to the last orientation.
"""

PRIOR_AGE = 100_000_000
"""ns; an orientation older than this no longer tells where the hand is now."""


class Solver:
    """
    Orientation of each joint sample, sign-continuous, each checked by the redundant fourth sensor.

    Plain floats; one sample a call.

    Parameters
    ----------
    geometry : Geometry
        Link angles.
    sigma : tuple of 4 float
        Standard deviations of th1A, th1B, th1C, th3A, rad.
    method : str
        One of `METHODS`.
    parity_limit : float
        Largest magnitude of the parity residual, in its standard deviations, of a sample whose four
        angles agree.

    """

    def __init__(self, geometry: Geometry, sigma: tuple[float, float, float, float],
                 method: str = 'estimate', parity_limit: float = 6.0):
        self._geometry = geometry
        self._sigma = sigma
        self._method = method
        self._parity_limit = parity_limit
        self._stamp: int | None = None
        self._quaternion: tuple[float, float, float, float] | None = None

    def solve(self, stamp: int, angles: tuple[float, float, float, float]) -> SampleEstimate:
        """
        Return the orientation of a sample.

        Parameters
        ----------
        stamp : int
            When the sample was taken, ns; it has to grow from call to call.
        angles : tuple of 4 float
            th1A, th1B, th1C, th3A, rad.

        Raises
        ------
        RejectedError
            The sample is not finite, not newer, not consistent or does not determine an
            orientation.

        """
        if not all(map(isfinite, angles)):
            raise RejectedError('angle not finite', f'{list(angles)} rad')
        if self._stamp is not None and stamp <= self._stamp:
            raise RejectedError('sample not newer than the last',
                                f'{(self._stamp - stamp) * 1e-9:.6f} s older')
        prior = None
        if self._stamp is not None and stamp - self._stamp <= PRIOR_AGE:
            prior = self._quaternion
        try:
            estimate = self._checked(angles, prior)
            if self._method == 'theta3a':
                estimate = estimate._replace(
                    quaternion=theta3a_quaternion(*angles, self._geometry))
            elif self._method == 'classic':
                estimate = self._classic(angles, prior or estimate.quaternion)
        except RejectedError:
            raise
        except SpmError as error:
            raise RejectedError('no orientation fits', str(error)) from error
        self._stamp = stamp
        self._quaternion = _continued(estimate.quaternion, self._quaternion)
        return estimate._replace(quaternion=self._quaternion)

    def _checked(self, angles, prior) -> SampleEstimate:
        """Estimate from all four sensors, which must not contradict each other."""
        estimate = estimate_sample(*angles, self._sigma, self._geometry, prior)
        if not abs(estimate.parity) <= self._parity_limit:
            raise RejectedError(
                'inconsistent angles', f'parity {estimate.parity:.1f} sigma, '
                f'limit {self._parity_limit:g}')
        self._determined(estimate)
        return estimate

    def _classic(self, angles, prior) -> SampleEstimate:
        """Solve the three active joints alone; two assembly modes near each other are no answer."""
        tracked = track_mode(angles[:3], matrix_from_quaternion(prior), self._geometry)
        if tracked.ambiguous:
            raise RejectedError('assembly modes too near to tell',
                                f'the nearest {tracked.distance:.4f} rad from the last orientation')
        quaternion = tuple(quaternion_from_matrix(tracked.rotation).tolist())
        estimate = estimate_sample(
            *angles, self._sigma, self._geometry, quaternion, missing='joint_3a')
        self._determined(estimate)
        return estimate._replace(quaternion=quaternion)

    @staticmethod
    def _determined(estimate) -> None:
        if not estimate.valid:
            deviation = sqrt(sum(estimate.covariance[::4]))
            raise RejectedError('orientation not determined',
                                f'standard deviation {deviation:.3g} rad')


def _continued(quaternion, last):
    """Of q and -q return the one that continues `last`; at the beginning the one with w >= 0."""
    x, y, z, w = quaternion
    along = w if last is None else x * last[0] + y * last[1] + z * last[2] + w * last[3]
    return quaternion if along >= 0.0 else (-x, -y, -z, -w)
