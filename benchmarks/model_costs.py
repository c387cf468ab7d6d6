# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `benchmarks.kinematics` measures: the package's models, and those one would use instead."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import math
import time
from typing import NamedTuple

import numpy as np
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.force import ForceController, ForceLimits, ForceSample, Gravity, Wrench
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.kinematics import (
    estimate,
    estimate_sample,
    forward_all,
    forward_theta3a,
    Geometry,
    inverse,
    jacobian,
    matrix_from_zxz,
    quaternion_from_matrix,
    theta3a_quaternion,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.supervisor import make_supervisor

# Length of one measurement of one entry (s), and calls of one of the scalar unit.
SLICE = 0.01
UNIT_CALLS = 40_000
# Samples of a batch.
BATCH = 100_000
# Samples of a moving device, and those of them that it takes to start (samples).
MOVING, STARTED = 300, 20
# Samples after which force is engaged.
ENGAGED = 150
# Noise of a sensor, standard deviation (rad).
SIGMA = math.radians(0.04)

# Weight of handle and proximal links (kg m).
WEIGHT = Gravity(handle=(0.001, 0.0, 0.004), proximal=(0.001, 0.0) * 3)
# Links and axes of the mechanism as built: deviations from the nominal one (rad, unit 1).
DEVIATION = math.radians(0.5)
# Suffix of the entries of the mechanism as built.
BUILT = ', as built'

# Entries that are compared with each other: a closed form, an estimate from four and from six
# sensors, a sample through the supervision by number of sensors, and the models to choose instead.
CASE_2 = 'Case 2, four floats to quaternion'
FOUR = 'estimate_sample, floats'
SIX = 'the same, six sensors'
SUPERVISED = {
    4: 'supervision and estimate, one sample',
    5: 'the same with five sensors',
    6: 'the same with six sensors',
}
NEWTON = 'Newton-Raphson with numpy'
MULTI_BODY = 'multi-body model (MuJoCo)'

# A function that measures something and returns seconds a call.
Measurement = Callable[[], float]


class Entry(NamedTuple):
    """Something that is measured, in its unit: scalar code or an element of a batch."""

    name: str
    measure: Measurement
    reach: int | None = None  # largest cost in units; None without a limit
    batch: int = 1  # elements of a batch that one call computes; 1 is scalar code


class Newton:
    """Newton-Raphson on the three loop closures with numpy, from the last orientation."""

    def __init__(self, g: Geometry) -> None:
        self.axes = np.array(g.platform_axes).T
        self.cos_beta = np.cos(g.betas)
        self.second = np.array([leg.second for leg in g.legs])

    def solve(self, th1: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the orientation at th1, starting from R, and the number of steps."""
        second = (
            self.second[:, 0]
            + np.cos(th1)[:, None] * self.second[:, 1]
            + np.sin(th1)[:, None] * self.second[:, 2]
        )
        for step in range(1, 51):
            third = (R @ self.axes).T
            rates = np.cross(third, second)
            omega = np.linalg.solve(rates, self.cos_beta - (second * third).sum(axis=1))
            angle = np.linalg.norm(omega)
            x, y, z = omega / max(angle, 1e-300)
            k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            R = R + (math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k) @ R
            if angle < 1e-12:
                return R, step
        raise ArithmeticError('Newton-Raphson did not converge')


def timed(call: Callable[[], object]) -> Measurement:
    """Return a function that calls `call` for a slice and returns seconds a call."""
    call()  # the first call is slower
    start = time.process_time()
    call()
    repeats = max(1, int(SLICE / max(time.process_time() - start, 1e-8)))
    loop = range(repeats)

    def run() -> float:
        start = time.process_time()
        for _ in loop:
            call()
        return (time.process_time() - start) / repeats

    return run


def unit_of_scalars() -> Measurement:
    """Return a function that measures one call of `math.sin`."""
    loop = range(UNIT_CALLS)
    x = 0.7
    sin = math.sin

    def run() -> float:
        start = time.process_time()
        for _ in loop:
            sin(x)
        return (time.process_time() - start) / UNIT_CALLS

    return run


def unit_of_batches() -> Measurement:
    """Return a function that measures one element of `numpy.sin`."""
    angles = np.linspace(-3.0, 3.0, BATCH)

    def run() -> float:
        start = time.process_time()
        np.sin(angles)
        return (time.process_time() - start) / BATCH

    return run


def as_built() -> Geometry:
    """Return a mechanism with every link and axis off by about `DEVIATION`."""
    rng, g = np.random.default_rng(1), Geometry()
    base, platform = (
        np.array(axes) + DEVIATION * rng.normal(size=(3, 3))
        for axes in (g.base_axes, g.platform_axes)
    )
    return Geometry.from_axes(
        base / np.linalg.norm(base, axis=1, keepdims=True),
        platform / np.linalg.norm(platform, axis=1, keepdims=True),
        g.alphas + DEVIATION * rng.normal(size=3),
        g.betas + DEVIATION * rng.normal(size=3),
    )


def models(g: Geometry, suffix: str) -> list[Entry]:
    """Return the package's models of one mechanism."""
    R = matrix_from_zxz(math.radians(135.0), 0.9, math.radians(30.0))
    joints = inverse(R, g)
    rng = np.random.default_rng(0)
    six = np.append(joints.theta1, [joints.theta3a, joints.theta3b, joints.theta3c])
    angles = six[:4] + SIGMA * rng.normal(size=4)
    further = (six[4:] + SIGMA * rng.normal(size=2)).tolist()
    floats, th1, th3a = tuple(angles.tolist()), angles[:3], angles[3]
    with_fifth, with_sixth = (*floats, further[0]), (*floats, *further)
    four, five, six_used = (UsedSensors((SIGMA,) * number) for number in (4, 5, 6))
    batch_th1 = th1 + 1e-3 * rng.normal(size=(BATCH, 3))
    batch_th3a = th3a + 1e-3 * rng.normal(size=BATCH)

    def batch() -> object:
        return forward_theta3a(batch_th1, batch_th3a, g)

    def batch_estimate() -> object:
        return estimate(batch_th1, batch_th3a, SIGMA, g)

    entries = [
        Entry(CASE_2, timed(lambda: theta3a_quaternion(*floats, g)), 150),
        Entry(FOUR, timed(lambda: estimate_sample(floats, four, g)), 1200),
        Entry('the same, five sensors', timed(lambda: estimate_sample(with_fifth, five, g))),
        Entry(SIX, timed(lambda: estimate_sample(with_sixth, six_used, g))),
        Entry('estimate, one sample', timed(lambda: estimate(th1, th3a, SIGMA, g)), 1200),
        Entry('forward_all', timed(lambda: forward_all(th1, g)), 8000),
        Entry(f'Case 2, one of {BATCH}', timed(batch), 60, BATCH),
        Entry(f'estimate, one of {BATCH}', timed(batch_estimate), None, BATCH),
    ]
    return [entry._replace(name=entry.name + suffix) for entry in entries]


def statics(motors: int, phi_deg: float, limit: float = 0.5) -> Measurement:
    """Return a function that measures motor torques and rendered torque of one pose."""
    rotation = tuple(workspace_pose(0.1, 0.7, math.radians(phi_deg)).ravel().tolist())
    found = make_statics(Geometry(), (1, 1, 1), motors, ForceLimits(motor_torque=limit))

    def one() -> object:
        found.place(rotation)
        return found.render((0.1, 0.2, 0.05))

    return timed(one)


def force(motors: int, gravity: Gravity | None = None) -> Measurement:
    """Return a function that measures a sample through the force feedback, engaged."""
    R = workspace_pose(0.1, 0.7, math.radians(20.0))
    joints, (x, y, z, w) = inverse(R), quaternion_from_matrix(R).tolist()
    angles = (*joints.theta1.tolist(), float(joints.theta3a))
    samples = [
        ForceSample(
            stamp, angles, (x, y, z, w), (0.1, 0.02, 0.03), wrench=Wrench(stamp, (0.0, 0.0, 0.02))
        )
        for stamp in range(1, MOVING * 1_000_000, 1_000_000)
    ]

    def run() -> float:
        controller = ForceController(motors=motors, gravity=gravity)
        for sample in samples[:ENGAGED]:
            controller.take(sample)
        begin = time.process_time()
        for sample in samples[ENGAGED:]:
            controller.take(sample)
        return (time.process_time() - begin) / (MOVING - ENGAGED)

    return run


def supervision(sensors: int) -> Measurement:
    """Return a function that measures a sample of a moving device through the supervision."""
    t = 1e-3 * np.arange(MOVING)
    joints = inverse(
        workspace_pose(
            np.radians(8.0 * (1.0 - np.cos(0.9 * t))),
            1.2 * t,
            np.radians(30.0 + 20.0 * np.sin(0.5 * t)),
        )
    )
    angles = np.column_stack([joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c])
    angles += SIGMA * np.random.default_rng(1).normal(size=angles.shape)
    rows = [tuple(row) for row in angles[:, :sensors].tolist()]

    def run() -> float:
        supervisor = make_supervisor(complete(FKM_SETTINGS, {'sensors': sensors}))
        for stamp, row in enumerate(rows[:STARTED], start=1):
            with suppress(RejectedError):
                supervisor.take(stamp * 1_000_000, row)
        begin = time.process_time()
        for stamp, row in enumerate(rows[STARTED:], start=STARTED + 1):
            supervisor.take(stamp * 1_000_000, row)
        return (time.process_time() - begin) / (MOVING - STARTED)

    return run


def entries() -> list[Entry]:
    """Return everything that is measured."""
    from paper.mujoco_model import MultiBody  # needs mujoco

    g = Geometry()
    th1, last = newton_start(g)
    newton = Newton(g)
    body = MultiBody(g)
    body.place(th1, last)
    passive = body.data.qpos.copy()

    def assemble() -> tuple:
        body.data.qpos[:] = passive
        return body.assemble(th1)

    return [
        *models(g, ''),
        *models(as_built(), BUILT),
        Entry(SUPERVISED[4], supervision(4), 1800),
        Entry(SUPERVISED[5], supervision(5)),
        Entry(SUPERVISED[6], supervision(6)),
        Entry('force feedback, three motors, one sample', force(3), 400),
        Entry('force feedback, four motors, one sample', force(4), 400),
        Entry('the same of three, with the weight', force(3, WEIGHT)),
        Entry('force of three motors', statics(3, 20.0), 200),
        Entry('force of three motors, faded', statics(3, 45.0)),
        Entry('force of four motors', statics(4, 20.0), 250),
        Entry('force of four motors, at the limit', statics(4, 20.0, 0.1)),
        Entry(NEWTON, timed(lambda: newton.solve(th1, last))),
        Entry(MULTI_BODY, timed(assemble)),
    ]


def newton_start(g: Geometry) -> tuple[np.ndarray, np.ndarray]:
    """Return readings of the active joints, rad, and the orientation 0.3 deg away from theirs."""
    orientation = matrix_from_zxz(math.radians(135.0), 0.9, math.radians(30.0))
    last = matrix_from_zxz(math.radians(135.0), 0.9, math.radians(29.7))
    noise = SIGMA * np.random.default_rng(0).normal(size=3)
    return inverse(orientation, g).theta1 + noise, last


def newton_agreement() -> str:
    """Return how the models that one would use instead agree, in words."""
    from paper.mujoco_model import MultiBody  # needs mujoco

    g = Geometry()
    th1, last = newton_start(g)
    found, steps = Newton(g).solve(th1, last)
    body = MultiBody(g)
    body.place(th1, last)
    difference = np.abs(found - body.assemble(th1)[0]).max()
    return (
        f'Newton-Raphson from 0.3 deg away: {steps} steps; differs from the multi-body model by '
        f'{difference:.1e}; cond G = {np.linalg.cond(jacobian(last)):.0f}'
    )
