# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The parameters that free motion may determine, and how well they explain its readings.

The parameters are a vector, with N sensors in this order: N zeros; 6 deviations of the link angles
(proximal A, B, C, distal A, B, C); 3 of the base axes; 3 of the platform axes; 2 N coefficients
of the first harmonics (cosine, sine of each encoder); 2 N of the second ones. All in rad, all 0
for the drawing. The axes have three numbers each set, as the frames take the other three: the
base's are the angle from Z1A to Z1B and the two directions of Z1C, the platform's the three
deviations that are no rotation of the platform.

A sample with N sensors has N readings and three unknowns of its own, its orientation. In units of
the sensors' noise, with the Jacobian J = d angles / d rotation and its null space U (U^T J = 0),
U^T (reading - angle) are the N - 3 numbers that no orientation explains: the parity vector.
Minimising its sum of squares over the parameters is weighted total least squares, as each sample
has its own maximum-likelihood orientation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from math import radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.watch.slip_evidence import projected, reached, sensor_angles
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import forward_theta3a, Geometry, in_usual_frames
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, LEG_NAMES
from spm_haptic_master.kinematics.rotations import matrix_from_vector, wrapped

Array = NDArray[np.float64]

# Groups of parameters, in the order in which a motion determines them.
GROUPS = ('zeros', 'links', 'base axes', 'platform axes', 'first harmonics', 'second harmonics')

# Tolerance of the second harmonics over that of the first ones (unit 1).
SECOND_HARMONIC = 0.1
# Number of mechanisms that are kept: those of a vector and of its differences.
GEOMETRIES = 32
# Step of the parameters in the forward differences (rad): truncation and rounding are below 1e-5
# of the derivative.
DIFFERENCE = 1e-6
# Steps of an orientation towards its maximum-likelihood value from the closed form.
ROTATION_STEPS = 3
# Longest step of an orientation (rad): a longer one comes of a sample that fits nothing.
LONGEST_STEP = 0.3


@dataclass(frozen=True)
class Layout:
    """
    A rig as drawn, and the meaning of its parameter vector.

    The order of the parameters is that of the module's description.

    Attributes
    ----------
    sensors : int
        Number N of sensors.
    nominal : Geometry
        The drawing, in its usual frames.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.
    mechanism_tolerance : float
        Standard deviation of each link angle and number of the axes before the fit, around the
        drawing, rad.
    harmonic_tolerance : float
        The same of each coefficient of the first harmonics, rad; of the second ones it is
        `SECOND_HARMONIC` times that.

    Raises
    ------
    InputError
        The base axes of the drawing are not in the usual frames.

    """

    sensors: int
    nominal: Geometry = Geometry()
    working_mode: tuple[int, int, int] = (1, 1, 1)
    mechanism_tolerance: float = radians(0.5)
    harmonic_tolerance: float = radians(0.3)

    def __post_init__(self) -> None:
        """Raise InputError if Z1B of the drawing has a component in y."""
        usual = in_usual_frames(self.nominal, self.nominal)
        if not np.allclose(
            usual.base_axes,
            self.nominal.base_axes,
            rtol=0.0,
            atol=1e-9,
        ):
            raise InputError(
                'geometry.base_axes: expected axes of the drawing in the usual '
                'frames, Z1A = z and Z1B in the half plane of positive x of x and z'
            )

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Return the place of each group in the vector."""
        n = self.sensors
        ends = [0, *accumulate((n, 6, 3, 3, 2 * n, 2 * n))]
        return {group: slice(*place) for group, place in zip(GROUPS, pairwise(ends), strict=True)}

    @property
    def count(self) -> int:
        """Return the length P of the vector."""
        end: int = self.slices[GROUPS[-1]].stop
        return end

    def columns(self, group: str) -> range:
        """
        Return the places of a group's parameters.

        Parameters
        ----------
        group : str
            One of `GROUPS`.

        Returns
        -------
        range
            Places in the vector.

        """
        return range(self.count)[self.slices[group]]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the name of each parameter."""
        joints = ALL_JOINT_NAMES[: self.sensors]
        return (
            *(f'zero of {joint}' for joint in joints),
            *(f'{part} link {leg}' for part in ('proximal', 'distal') for leg in LEG_NAMES),
            'angle from Z1A to Z1B',
            'Z1C towards Z1A',
            'Z1C across Z1A',
            *(f'platform axes, deviation {number}' for number in (1, 2, 3)),
            *(
                f'{order} harmonic of {joint}, {part}'
                for order in ('first', 'second')
                for joint in joints
                for part in ('cosine', 'sine')
            ),
        )

    @cached_property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter before the fit, rad; inf for zeros."""
        mechanism = self.mechanism_tolerance
        harmonic = self.harmonic_tolerance
        return np.repeat(
            (np.inf, *[mechanism] * 3, harmonic, harmonic * SECOND_HARMONIC),
            [len(self.columns(group)) for group in GROUPS],
        )

    @cached_property
    def platform_tangents(self) -> Array:
        """
        Return three deviations of the platform axes that are no rotation, shape (3, 3, 3).

        They span the null space, in the nine components of the axes, of the three rotations of the
        platform and the three changes of length (by singular value decomposition). The first index
        is that of the deviation, then axis and component.
        """
        axes = np.array(self.nominal.platform_axes)
        units = np.eye(3)
        turns = np.stack([np.cross(unit, axes).ravel() for unit in units])
        lengths = (np.eye(3)[:, :, None] * axes).reshape(3, 9)
        # The null space of rotations and lengths.
        _, _, directions = np.linalg.svd(np.vstack([turns, lengths]))
        return directions[6:].reshape(3, 3, 3)

    def geometry(self, vector: Array) -> Geometry:
        """
        Return the mechanism of a vector, in its usual frames.

        Parameters
        ----------
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        Geometry
            Link angles and axes.

        Raises
        ------
        GeometryError
            There is no such mechanism.

        """
        mechanism = vector[self.slices['links'].start : self.slices['platform axes'].stop]
        return _geometry(self, mechanism.tobytes())

    def harmonics(self, vector: Array) -> tuple[Array, Array]:
        """
        Return the coefficients of the encoders' harmonics.

        Parameters
        ----------
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        first : ndarray, shape (N, 2)
            Cosine and sine of the first harmonic, rad.
        second : ndarray, shape (N, 2)
            The same of the second one.

        """
        first, second = (vector[self.slices[group]].reshape(-1, 2) for group in GROUPS[4:])
        return first, second

    def harmonic_deviation(
        self,
        angles: Array,
        vector: Array,
    ) -> tuple[Array, Array]:
        """
        Return how far the harmonics move the readings at joint angles.

        reading - angle = sum over the orders k of c_k cos(k angle) + s_k sin(k angle).

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles, rad.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        deviation : ndarray, shape (n, N)
            Reading minus angle, rad.
        slope : ndarray, shape (n, N)
            Its derivative by the angle (unit 1).

        """
        deviation = slope = 0.0 * angles + np.zeros(self.sensors)
        for order, (cosine, sine) in enumerate((each.T for each in self.harmonics(vector)), 1):
            if not (cosine.any() or sine.any()):
                continue
            c = np.cos(order * angles)
            s = np.sin(order * angles)
            deviation = deviation + cosine * c + sine * s
            slope = slope + order * (sine * c - cosine * s)
        return deviation, slope


@lru_cache(maxsize=GEOMETRIES)
def _geometry(layout: Layout, numbers: bytes) -> Geometry:
    """
    Return a mechanism by the bytes of its part of a vector.

    Bytes can be hashed, so that a mechanism is built once for all derivatives at a vector.

    Parameters
    ----------
    layout : Layout
        The rig as drawn, and the meaning of the parameter vector.
    numbers : bytes
        The twelve numbers of links, base axes and platform axes, float64, rad.

    Returns
    -------
    Geometry
        Link angles and axes, in the usual frames of the drawing.

    """
    nominal = layout.nominal
    proximal, distal, (turn, towards, across), deviations = np.frombuffer(numbers).reshape(4, 3)
    axes = np.array(nominal.base_axes)
    angle = np.arctan2(axes[1, 0], axes[1, 2]) + turn
    axes[1] = np.sin(angle), 0.0, np.cos(angle)
    # Z1C deviates towards Z1A, and across.
    to = axes[0] - (axes[0] @ axes[2]) * axes[2]
    to /= np.linalg.norm(to)
    axes[2] += towards * to + across * np.cross(axes[2], to)
    axes[2] /= np.linalg.norm(axes[2])
    platform = np.array(nominal.platform_axes) + np.tensordot(
        deviations,
        layout.platform_tangents,
        1,
    )
    built = Geometry.from_axes(
        axes,
        np.array([axis / np.linalg.norm(axis) for axis in platform]),
        np.array(nominal.alphas) + proximal,
        np.array(nominal.betas) + distal,
    )
    return in_usual_frames(built, nominal)


@dataclass(frozen=True, slots=True)
class Linearised:
    """
    Parity of n samples, that of the first four sensors first, and its derivatives.

    Attributes
    ----------
    usable : ndarray of bool, shape (n,)
        Which samples have an orientation within reach; the parity of the others is 0.
    parity : ndarray, shape (n, N - 3)
        Parity, standard deviations of white noise, continuous over the workspace.
    derivative : ndarray, shape (n, N - 3, columns)
        Derivative of the parity by the parameters asked for, 1/rad.
    rotation : ndarray, shape (n, 3, 3)
        Orientations, one Gauss-Newton step closer to the maximum-likelihood ones.

    """

    usable: NDArray[np.bool_]
    parity: Array
    derivative: Array
    rotation: Array


@dataclass(frozen=True, slots=True)
class MotionModel:
    """
    The readings that a mechanism with its encoders gives at orientations.

    Attributes
    ----------
    layout : Layout
        The rig as drawn, and the meaning of the parameters.
    sigma : ndarray, shape (N,)
        White noise of each sensor, rad, 1 standard deviation.

    """

    layout: Layout
    sigma: Array

    def joint_angles(self, rotation: Array, geometry: Geometry) -> Array:
        """
        Return the angles of the sensors' joints, rad, shape (n, N); NaN out of reach.

        Parameters
        ----------
        rotation : ndarray, shape (n, 3, 3)
            Orientations R_base_platform; NaN where there is none.
        geometry : Geometry
            Link angles and axes of the mechanism.

        Returns
        -------
        ndarray, shape (n, N)
            In the order of ALL_JOINT_NAMES.

        """
        return sensor_angles(
            rotation,
            geometry,
            self.layout.working_mode,
            self.layout.sensors,
        )

    def orientations(self, turned: Array, vector: Array) -> Array:
        """
        Return the maximum-likelihood orientations of readings.

        The closed form of the first four angles is the start; Gauss-Newton steps (`linearised`)
        take all sensors in.

        Parameters
        ----------
        turned : ndarray, shape (n, N)
            Readings times their directions, with the zeros still in them, rad.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        ndarray, shape (n, 3, 3)
            R_base_platform; NaN where there is none.

        """
        angles = self.corrected(turned, vector)
        rotation = forward_theta3a(angles[:, :3], angles[:, 3], self.layout.geometry(vector))
        for _ in range(ROTATION_STEPS):
            rotation = self.linearised(turned, rotation, vector).rotation
        return rotation

    def corrected(self, turned: Array, vector: Array) -> Array:
        """
        Return the joint angles by readings: without zeros and harmonics.

        As the harmonics depend on the angle, it is found by two fixed-point iterations.

        Parameters
        ----------
        turned : ndarray, shape (n, N)
            Readings times their directions, with the zeros still in them, rad.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        ndarray, shape (n, N)
            Joint angles, rad.

        """
        angles = from_zero = wrapped(turned - vector[self.layout.slices['zeros']])
        for _ in range(2):
            angles = from_zero - self.layout.harmonic_deviation(angles, vector)[0]
        return angles

    def readings(self, rotation: Array, vector: Array) -> Array:
        """
        Return the readings that orientations give, by their directions.

        Parameters
        ----------
        rotation : ndarray, shape (n, 3, 3)
            Orientations R_base_platform; NaN where there is none.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        ndarray, shape (n, N)
            Joint angles with zeros and harmonics, rad; NaN out of reach.

        """
        angles = self.joint_angles(rotation, self.layout.geometry(vector))
        return angles + self.linear_part(angles, vector)

    def linearised(
        self,
        turned: Array,
        rotation: Array,
        vector: Array,
        columns: tuple[int, ...] = (),
    ) -> Linearised:
        """
        Return parity, its derivatives and a step of the orientations.

        The residuals, reading minus predicted reading in units of the noise, are split by a QR
        decomposition of the Jacobian into a part that a rotation explains, which is the
        Gauss-Newton step of the orientation, and the parity.

        Parameters
        ----------
        turned : ndarray, shape (n, N)
            Readings times their directions, with the zeros still in them, rad.
        rotation : ndarray, shape (n, 3, 3)
            Orientations near the maximum-likelihood ones; NaN where there is none.
        vector : ndarray, shape (P,)
            Parameters, rad.
        columns : tuple of int, optional
            Places of the parameters whose derivatives are wanted.

        Returns
        -------
        Linearised
            Parity and derivatives at these orientations, and orientations one step closer.

        """
        layout = self.layout
        usable, matrices, angles, rates = reached(
            rotation,
            layout.geometry(vector),
            layout.working_mode,
            layout.sensors,
        )
        deviation, slope = layout.harmonic_deviation(angles, vector)
        residual = wrapped(turned - vector[layout.slices['zeros']] - angles - deviation)
        of_readings = rates * (1.0 + slope)[:, :, None]
        found = projected(usable, residual, of_readings, self.sigma)
        # No step is NaN where a reading is.
        longest = np.abs(found.step).max(axis=1)
        usable = usable & (longest < LONGEST_STEP)
        gain = np.where(usable[:, None, None], _continuous(found.gain, rates), 0.0)
        known = np.where(usable[:, None], residual, 0.0)
        parity = np.einsum('nki,ni->nk', gain, known)
        step = np.where(usable[:, None], found.step, 0.0)
        moved = matrix_from_vector(step) @ rotation
        # The derivative of the parity is that of the residuals, seen through the gain.
        by = self._derivative(matrices, angles, slope, vector, columns)
        return Linearised(
            usable=usable,
            parity=parity,
            derivative=gain @ by,
            rotation=moved,
        )

    def orientation_changes(self, rotation: Array, vector: Array) -> Array:
        """
        Return how the orientations of given readings change with the parameters.

        Weighted least squares: the pseudo-inverse of the whitened Jacobian times the whitened
        derivative.

        Parameters
        ----------
        rotation : ndarray, shape (n, 3, 3)
            Orientations within reach.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        ndarray, shape (n, 3, P)
            Rotation vectors in the base frame by each parameter, rad/rad.

        """
        layout = self.layout
        _, _, angles, rates = reached(
            rotation,
            layout.geometry(vector),
            layout.working_mode,
            layout.sensors,
        )
        slope = layout.harmonic_deviation(angles, vector)[1]
        by = self._derivative(
            rotation,
            angles,
            slope,
            vector,
            tuple(range(layout.count)),
        )
        of_readings = rates * (1.0 + slope)[:, :, None]
        white = of_readings / self.sigma[:, None]
        return np.asarray(np.linalg.pinv(white) @ (by / self.sigma[:, None]))

    def _derivative(
        self,
        rotation: Array,
        angles: Array,
        slope: Array,
        vector: Array,
        columns: tuple[int, ...],
    ) -> Array:
        """
        Return the derivatives of reading minus predicted reading by the parameters.

        By forward differences for links and axes, exact for zeros and harmonics, which are linear.

        Parameters
        ----------
        rotation : ndarray, shape (n, 3, 3)
            Orientations within reach.
        angles : ndarray, shape (n, N)
            Joint angles there, rad.
        slope : ndarray, shape (n, N)
            Derivative of the harmonics' deviation by the angle (unit 1).
        vector : ndarray, shape (P,)
            Parameters, rad.
        columns : tuple of int
            Places of the parameters in the vector.

        Returns
        -------
        ndarray, shape (n, N, columns)
            rad/rad.

        """
        layout = self.layout
        mechanism = range(layout.slices['links'].start, layout.slices['platform axes'].stop)
        found = np.zeros((*angles.shape, len(columns)))
        for place, column in enumerate(columns):
            unit = np.zeros(layout.count)
            unit[column] = 1.0
            if column in mechanism:
                change = (
                    wrapped(
                        self.joint_angles(rotation, layout.geometry(vector + DIFFERENCE * unit))
                        - angles
                    )
                    / DIFFERENCE
                )
                found[:, :, place] = np.nan_to_num(-change * (1.0 + slope))
            else:
                found[:, :, place] = -self.linear_part(angles, unit)
        return found

    def linear_part(self, angles: Array, vector: Array) -> Array:
        """
        Return reading minus joint angle, which is linear in zeros and harmonics.

        Parameters
        ----------
        angles : ndarray, shape (n, N)
            Joint angles, rad.
        vector : ndarray, shape (P,)
            Parameters, rad.

        Returns
        -------
        ndarray, shape (n, N)
            Zeros and harmonics' deviation, rad.

        """
        return (
            vector[self.layout.slices['zeros']] + self.layout.harmonic_deviation(angles, vector)[0]
        )


def _continuous(gain: Array, rates: Array) -> Array:
    """
    Return gains in a basis of the parity that does not jump between poses.

    Its first vector is along the signed 3 x 3 minors of the first four rows of J, and 0 for all
    further sensors; that of each of these is 0 for those after it and positive for itself. (The
    vectors of a QR decomposition change their sign where an element of J does.)

    Returns
    -------
    ndarray, shape (n, N - 3, N)
        The same gains in that basis.

    """
    further = gain.shape[1] - 1
    if further:
        # The last sensor comes first: its row becomes (x, 0, ...), the next one (x, x, ...).
        rotation, lower = np.linalg.qr(gain[:, :, :3:-1], mode='complete')
        rotation[:, :, :further] *= np.where(
            np.diagonal(lower, axis1=1, axis2=2) < 0.0,
            -1.0,
            1.0,
        )[:, None]
        gain = (rotation.swapaxes(1, 2) @ gain)[:, ::-1]
    first = np.cross(rates[:, 0], rates[:, 1])
    last = np.cross(rates[:, 2], rates[:, 3])
    minors = np.stack(
        [
            (rates[:, 1] * last).sum(1),
            -(rates[:, 0] * last).sum(1),
            (rates[:, 3] * first).sum(1),
            -(rates[:, 2] * first).sum(1),
        ],
        axis=1,
    )
    signs = np.ones(gain.shape[:2])
    signs[np.einsum('ni,ni->n', gain[:, 0, :4], minors) < 0.0, 0] = -1.0
    return gain * signs[:, :, None]
