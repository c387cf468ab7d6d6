# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the forward models cost, in units that mean the same on any machine.

Scalars are counted in calls of `math.sin`, batches in elements of `numpy.sin`, both measured in the
same run and interleaved with what they are compared to; each figure is the least of many rounds.
A machine that is busy makes all of them larger alike. Beside the package stand the models a user
would pick otherwise: Newton-Raphson with numpy on the three loop closures, and a multi-body model.

Run it with the package installed: python benchmarks/kinematics.py
"""

import math
import sys
import time

import numpy as np

from spm_haptic_master.kinematics import (
    estimate,
    estimate_sample,
    forward_all,
    forward_theta3a,
    Geometry,
    inverse,
    jacobian,
    matrix_from_zxz,
    theta3a_quaternion,
)

ROUNDS = 40
SLICE = 0.01
"""s; length of one measured slice of one entry."""

BATCH = 100_000
SIGMA = math.radians(0.04)


class Newton:
    """Newton-Raphson on the three loop closures with numpy, from the last orientation."""

    def __init__(self, g):
        """Take the geometry's platform axes."""
        self.g = g
        self.axes = np.array(g.platform_axes).T
        self.cos_beta = math.cos(g.beta)

    def solve(self, th1, R):
        """Orientation at th1, from R; and the number of steps."""
        c, s = np.cos(th1), np.sin(th1)
        ca, sa = self.g.cos_alpha, self.g.sin_alpha
        second = np.array([[sa * s[0], -sa * c[0], ca], [ca, sa * s[1], -sa * c[1]],
                           [-sa * c[2], ca, sa * s[2]]])
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


def timed(call):
    """Return a function that runs `call` for a slice and returns seconds a call."""
    start = time.perf_counter()
    call()
    repeats = max(1, int(SLICE / max(time.perf_counter() - start, 1e-8)))
    loop = range(repeats)

    def run():
        start = time.perf_counter()
        for _ in loop:
            call()
        return (time.perf_counter() - start) / repeats

    return run


def unit_of_scalars():
    """Return a function that measures one call of `math.sin`."""
    loop, x, sin = range(20000), 0.7, math.sin

    def run():
        start = time.perf_counter()
        for _ in loop:
            sin(x)
        return (time.perf_counter() - start) / 20000

    return run


def entries():
    """Name, measurement, what it is counted in, divisor and reach of everything measured."""
    from paper.mujoco_model import MultiBody  # needs mujoco
    g = Geometry()
    phi, warm = math.radians(30.0), math.radians(29.7)
    R, last = (matrix_from_zxz(math.radians(135.0), 0.9, angle) for angle in (phi, warm))
    joints = inverse(R)
    rng = np.random.default_rng(0)
    angles = np.append(joints.theta1, joints.theta3a) + SIGMA * rng.normal(size=4)
    floats, four, th1, th3a = tuple(angles.tolist()), (SIGMA,) * 4, angles[:3], angles[3]
    newton, body = Newton(g), MultiBody(g)
    body.place(th1, last)
    passive = body.data.qpos.copy()
    batch_th1 = th1 + 1e-3 * rng.normal(size=(BATCH, 3))
    batch_th3a = th3a + 1e-3 * rng.normal(size=BATCH)

    def assemble():
        body.data.qpos[:] = passive
        return body.assemble(th1)

    def batch():
        return forward_theta3a(batch_th1, batch_th3a)

    def batch_estimate():
        return estimate(batch_th1, batch_th3a, SIGMA)

    found, steps = newton.solve(th1, last)
    difference = np.abs(found - assemble()[0]).max()
    print(f'Newton-Raphson from 0.3 deg away: {steps} steps; differs from the multi-body model by '
          f'{difference:.1e}; cond G = {np.linalg.cond(jacobian(R)):.0f}\n')
    sine = np.linspace(-3.0, 3.0, BATCH)
    return [
        ('math.sin, one call', unit_of_scalars(), 'sin', 1, None),
        ('numpy.sin, one element', timed(lambda: np.sin(sine)), 'numpy', BATCH, None),
        ('Case 2, four floats to quaternion',
         timed(lambda: theta3a_quaternion(*floats, g)), 'sin', 1, 150),
        ('estimate_sample, floats',
         timed(lambda: estimate_sample(*floats, four, g)), 'sin', 1, 1200),
        ('estimate, one sample', timed(lambda: estimate(th1, th3a, SIGMA, g)), 'sin', 1, 1200),
        ('forward_all', timed(lambda: forward_all(th1, g)), 'sin', 1, 8000),
        (f'Case 2, one of {BATCH}', timed(batch), 'numpy', BATCH, 60),
        (f'estimate, one of {BATCH}', timed(batch_estimate), 'numpy', BATCH, None),
        ('Newton-Raphson with numpy', timed(lambda: newton.solve(th1, last)), 'sin', 1, None),
        ('multi-body model (MuJoCo)', timed(assemble), 'sin', 1, None),
    ]


def main():
    """Measure, interleaved, and print the table."""
    table = entries()
    least = [math.inf] * len(table)
    for count in range(ROUNDS):
        for index, (_, run, _, divisor, _) in enumerate(table):
            least[index] = min(least[index], run() / divisor)
        print(f'\rround {count + 1} of {ROUNDS}', end='', file=sys.stderr, flush=True)
    print(file=sys.stderr)
    units = {'sin': least[0], 'numpy': least[1]}
    print(f'{"":36}{"us":>10}{"units":>10}{"reach":>8}')
    for (name, _, unit, _, reach), seconds in zip(table, least, strict=True):
        ratio = seconds / units[unit]
        verdict = '' if reach is None else f'{reach:8}  {"met" if ratio <= reach else "not met"}'
        print(f'{name:36}{seconds * 1e6:10.3f}{ratio:10.1f}{verdict}')
    names = [entry[0] for entry in table]
    case2 = least[names.index('Case 2, four floats to quaternion')]
    for name, reach in (('Newton-Raphson with numpy', 20), ('multi-body model (MuJoCo)', None)):
        faster = least[names.index(name)] / case2
        verdict = '' if reach is None else f', reach {reach}: ' + (
            'met' if faster >= reach else 'not met')
        print(f'Case 2 is {faster:.0f} times faster than the {name}{verdict}')


if __name__ == '__main__':
    main()
