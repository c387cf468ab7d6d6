# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Cost of the forward models in units that mean the same on any machine.

The unit of scalar code is a call of `math.sin`, that of batches an element of `numpy.sin`; both
are measured in the same run, interleaved with the models. Each figure is the least processor time
of many rounds: a busy machine makes all larger alike. Beside the package are the models a user
would choose otherwise: Newton-Raphson with numpy on the three loop closures, and a multi-body
model.

Run it with the package installed: python -m benchmarks.kinematics
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import math
import sys
import time

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

# Rounds in which each entry is measured once.
ROUNDS = 40
# Length of one measurement of one entry (s).
SLICE = 0.01
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
# Largest cost of the mechanism as built over that of the nominal one (unit 1).
BUILT_REACH = 1.1
# Largest cost of an estimate from six sensors over that from four (unit 1); the same of a sample
# of five and of six sensors through the supervision.
SIX_REACH = 1.6
SUPERVISED_REACH = {5: 1.3, 6: 1.45}
# Suffix of the entries of the mechanism as built.
BUILT = ', as built'

# Entries of one sample from four, five and six sensors.
FOUR, FIVE, SIX = (
    'estimate_sample, floats',
    *(f'the same, {number} sensors' for number in ('five', 'six')),
)
# Entries of a sample through the supervision, by number of sensors.
SUPERVISED = {
    4: 'supervision and estimate, one sample',
    5: 'the same with five sensors',
    6: 'the same with six sensors',
}

# Name, measurement (s a call), unit, calls in a measurement, and largest cost in units.
Measurement = Callable[[], float]
Entry = tuple[str, Measurement, str, int, 'int | None']


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
    loop, x, sin = range(20000), 0.7, math.sin

    def run() -> float:
        start = time.process_time()
        for _ in loop:
            sin(x)
        return (time.process_time() - start) / 20000

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

    return [
        (
            'Case 2, four floats to quaternion' + suffix,
            timed(lambda: theta3a_quaternion(*floats, g)),
            'sin',
            1,
            150,
        ),
        (FOUR + suffix, timed(lambda: estimate_sample(floats, four, g)), 'sin', 1, 1200),
        (FIVE + suffix, timed(lambda: estimate_sample(with_fifth, five, g)), 'sin', 1, None),
        (SIX + suffix, timed(lambda: estimate_sample(with_sixth, six_used, g)), 'sin', 1, None),
        (
            'estimate, one sample' + suffix,
            timed(lambda: estimate(th1, th3a, SIGMA, g)),
            'sin',
            1,
            1200,
        ),
        ('forward_all' + suffix, timed(lambda: forward_all(th1, g)), 'sin', 1, 8000),
        (f'Case 2, one of {BATCH}' + suffix, timed(batch), 'numpy', BATCH, 60),
        (f'estimate, one of {BATCH}' + suffix, timed(batch_estimate), 'numpy', BATCH, None),
    ]


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
    phi, warm = math.radians(30.0), math.radians(29.7)
    R, last = (matrix_from_zxz(math.radians(135.0), 0.9, angle) for angle in (phi, warm))
    joints = inverse(R)
    th1 = joints.theta1 + SIGMA * np.random.default_rng(0).normal(size=3)
    newton, body = Newton(g), MultiBody(g)
    body.place(th1, last)
    passive = body.data.qpos.copy()

    def assemble() -> tuple:
        body.data.qpos[:] = passive
        return body.assemble(th1)

    found, steps = newton.solve(th1, last)
    difference = np.abs(found - assemble()[0]).max()
    print(
        f'Newton-Raphson from 0.3 deg away: {steps} steps; differs from the multi-body model by '
        f'{difference:.1e}; cond G = {np.linalg.cond(jacobian(R)):.0f}\n'
    )
    sine = np.linspace(-3.0, 3.0, BATCH)
    return [
        ('math.sin, one call', unit_of_scalars(), 'sin', 1, None),
        ('numpy.sin, one element', timed(lambda: np.sin(sine)), 'numpy', BATCH, None),
        *models(g, ''),
        *models(as_built(), BUILT),
        *(
            (name, supervision(sensors), 'sin', 1, 1800 if sensors == 4 else None)
            for sensors, name in SUPERVISED.items()
        ),
        ('force feedback, three motors, one sample', force(3), 'sin', 1, 400),
        ('force feedback, four motors, one sample', force(4), 'sin', 1, 400),
        ('the same of three, with the weight', force(3, WEIGHT), 'sin', 1, None),
        ('force of three motors', statics(3, 20.0), 'sin', 1, 200),
        ('force of three motors, faded', statics(3, 45.0), 'sin', 1, None),
        ('force of four motors', statics(4, 20.0), 'sin', 1, 250),
        ('force of four motors, at the limit', statics(4, 20.0, 0.1), 'sin', 1, None),
        ('Newton-Raphson with numpy', timed(lambda: newton.solve(th1, last)), 'sin', 1, None),
        ('multi-body model (MuJoCo)', timed(assemble), 'sin', 1, None),
    ]


def main() -> None:
    """Measure interleaved; print the table."""
    table = entries()
    least = [math.inf] * len(table)
    for count in range(ROUNDS):
        for index, (_, run, _, divisor, _) in enumerate(table):
            least[index] = min(least[index], run() / divisor)
        print(f'\rround {count + 1} of {ROUNDS}', end='', file=sys.stderr, flush=True)
    print(file=sys.stderr)
    units = {'sin': least[0], 'numpy': least[1]}
    print(f'{"":46}{"us":>10}{"units":>10}{"reach":>8}')
    for (name, _, unit, _, reach), seconds in zip(table, least, strict=True):
        ratio = seconds / units[unit]
        verdict = '' if reach is None else f'{reach:8}  {"met" if ratio <= reach else "not met"}'
        print(f'{name:46}{seconds * 1e6:10.3f}{ratio:10.1f}{verdict}')
    names = [entry[0] for entry in table]
    worst, name = max(
        (least[index] / least[names.index(name.removesuffix(BUILT))], name)
        for index, name in enumerate(names)
        if name.endswith(BUILT)
    )
    print(
        f'{name} costs {worst:.2f} of the nominal mechanism, the most of all, reach '
        f'{BUILT_REACH}: ' + ('met' if worst <= BUILT_REACH else 'not met')
    )
    ratio = least[names.index(SIX)] / least[names.index(FOUR)]
    print(
        f'An estimate from six sensors costs {ratio:.2f} of that from four, reach {SIX_REACH}: '
        + ('met' if ratio <= SIX_REACH else 'not met')
    )
    for sensors, reach in SUPERVISED_REACH.items():
        ratio = least[names.index(SUPERVISED[sensors])] / least[names.index(SUPERVISED[4])]
        print(
            f'A supervised sample of {sensors} sensors costs {ratio:.2f} of one of four, '
            f'reach {reach}: ' + ('met' if ratio <= reach else 'not met')
        )
    case2 = least[names.index('Case 2, four floats to quaternion')]
    for name, reach in (('Newton-Raphson with numpy', 20), ('multi-body model (MuJoCo)', None)):
        faster = least[names.index(name)] / case2
        verdict = (
            ''
            if reach is None
            else f', reach {reach}: ' + ('met' if faster >= reach else 'not met')
        )
        print(f'Case 2 is {faster:.0f} times faster than the {name}{verdict}')


if __name__ == '__main__':
    main()
