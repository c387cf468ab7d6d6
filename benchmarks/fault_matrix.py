# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drive the real chain through every fault, at every place, and print what came out of it.

Simulated encoders on a bus (sim_bus), encoder_driver and fkm run as processes. A cell tells how
many orientations went out between the fault's first wrong sample and the silence, how wrong the
worst of them was, and whom fkm named. `python test/fault_matrix.py [FILE.md]`.
"""

from __future__ import annotations

import os
import sys
import time

os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

from geometry_msgs.msg import QuaternionStamped
from harness import Observer, Program, stamp
import numpy as np
from recording import quaternions, rotation_angle
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from spm_haptic_master.kinematics import inverse, matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes.qos import STATE

CHANNEL = '239.74.250.1'
BUS = {'can.interface': 'udp_multicast', 'can.channel': CHANNEL}
NOISE_DEG = 0.04
# s; the fault begins, lasts, and what is watched after it.
START, DURATION, AFTER = 1.3, 0.5, 0.1
# rms of an orientation from four healthy sensors at these places, deg (bound of first order).
HEALTHY_DEG = 0.06

CENTRE = (135.0, 54.735610317)
PLACES = {
    'centre': {'sim.trajectory': 'fixed', 'sim.pose_deg': [*CENTRE, 20.0]},
    'edge': {'sim.trajectory': 'fixed', 'sim.pose_deg': [115.0, 45.0, 25.0]},
    'singular': {'sim.trajectory': 'fixed', 'sim.pose_deg': [*CENTRE, 49.358591780]},
    'crossing': {'sim.trajectory': 'fig9'},
}
FAULTY = ('joint_1b', 'joint_3a')
ONE_SENSOR = (
    ('step of 0.5 deg', 'offset', '=0.5'), ('step of 1 deg', 'offset', '=1'),
    ('step of 5 deg', 'offset', '=5'), ('one sample off by 5 deg', 'jump', '=5'),
    ('stuck', 'stuck', ''), ('noise of 0.5 deg', 'noise', '=0.5'), ('no answers', 'dropout', ''),
    ('node reboots', 'reboot', ''),
)
WHOLE_BUS = (('bus silent', 'silence', ''), ('bus off', 'busoff', ''))
HEALTHY = {
    'rest': PLACES['centre'], 'rest at the singularity': PLACES['singular'],
    'slow (Fig. 9)': PLACES['crossing'],
    'moving (sweep)': {'sim.trajectory': 'sweep', 'sim.tilt_max_deg': 20.0},
}
HEALTHY_SECONDS = 20.0


def truth(place: dict, t: np.ndarray) -> np.ndarray:
    """Return the true ZXZ angles, deg, (n, 3), at times s into the motion."""
    if place['sim.trajectory'] == 'fig9':
        phi = 45.0 + 10.0 * np.sin(np.pi * t / 10.0)
        return np.column_stack([np.full_like(t, CENTRE[0]), np.full_like(t, CENTRE[1]), phi])
    return np.broadcast_to(place['sim.pose_deg'], (len(t), 3))


class Chain:
    """encoder_driver and fkm on a bus, and an observer of what they publish."""

    def __init__(self):
        self.observer = Observer()
        self.samples = self.observer.collect(JointState, 'measured_js')
        self.orientations = self.observer.collect(QuaternionStamped, 'orientation')
        self.states = self.observer.collect(String, 'state', STATE)
        self._driver = Program('encoder_driver', parameters={'source': 'can', **BUS})
        self._fkm: Program | None = None

    def play(self, place: dict, seconds: float, *faults: str) -> None:
        """Let the encoders move for some seconds, before an fkm that knows of no fault."""
        if self._fkm is not None:
            self._fkm.stop()
        self._fkm = Program('fkm')
        if not self.observer.spin_until(
                lambda: self.observer.node.count_publishers('measured_js')
                and self.observer.node.count_publishers('orientation')
                and self.observer.node.count_subscribers('measured_js') > 1, 20.0):
            raise RuntimeError('encoder_driver or fkm did not start: '
                               + self._driver.stderr + self._fkm.stderr)
        self.observer.spin(0.5)
        for arrived in (self.samples, self.orientations, self.states):
            arrived.clear()
        parameters = {**BUS, **place, 'sim.noise_deg': NOISE_DEG}
        arguments = ['--sync', '--seconds', str(seconds + 2.0)]
        for name, value in parameters.items():
            arguments += ['-p', f'{name}:={value}']
        for fault in faults:
            arguments += ['--fault', fault]
        bus = Program('sim_bus', *arguments)
        if not self.observer.spin_until(lambda: self.samples, 15.0):
            raise RuntimeError(f'no joint samples: {bus.stdout} {bus.stderr}')
        self.observer.spin(seconds)
        bus.stop()
        if not self.orientations:
            raise RuntimeError(f'no orientation of {len(self.samples)} samples: '
                               f'{[m.data for _, m in self.states]} {self._fkm.stderr}')

    def close(self) -> None:
        """End everything."""
        for program in filter(None, (self._fkm, self._driver)):
            program.stop()
        self.observer.close()


def onset(kind: str, joint: str | None, place: dict, times, positions) -> float:
    """Return the time, s, of the first sample that the fault made wrong."""
    if joint is None or kind in ('dropout', 'reboot'):
        return START
    index = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a').index(joint)
    joints = inverse(matrix_from_zxz(*np.radians(truth(place, times)).T))
    true = np.column_stack([joints.theta1, joints.theta3a])[:, index]
    late = times > START - 0.05
    if kind == 'stuck':
        wrong = np.zeros(len(times), bool)
        wrong[:-8] = [len(set(positions[i:i + 9, index])) == 1 for i in range(len(times) - 8)]
    else:
        wrong = np.degrees(np.abs(positions[:, index] - true)) > 6.0 * NOISE_DEG
    found = np.flatnonzero(wrong & late)
    return times[found[0]] if len(found) else START


def judge(chain: Chain, place: dict, kind: str, joint: str | None) -> str:
    """Return a cell of the table."""
    sampled = np.array([stamp(message) for _, message in chain.samples])
    positions = np.array([message.position for _, message in chain.samples])
    first = sampled[0]
    begin = onset(kind, joint, place, (sampled - first) * 1e-9, positions)
    out = np.array([stamp(message) for _, message in chain.orientations])
    t = (out - first) * 1e-9
    true = quaternion_from_matrix(matrix_from_zxz(*np.radians(truth(place, t)).T))
    error = rotation_angle(quaternions(chain.orientations), true)
    during = (t >= begin) & (t < START + DURATION)
    # Samples of the fault that gave no orientation: the first of them is the detection.
    silent = np.setdiff1d(sampled[((sampled - first) * 1e-9 >= begin)
                                  & ((sampled - first) * 1e-9 < START + DURATION)], out)
    detected = silent[0] if len(silent) else np.iinfo(np.int64).max
    before, after = during & (out < detected), during & (out > detected)
    worst = f', {error[before].max():.2f}°' if before.any() else ''
    states = [m.data for _, m in chain.states if m.data not in ('starting', 'healthy')]
    if kind == 'jump':
        whose = 'kept back' if len(silent) else ('seen' if states else '**passed**')
    elif not states:
        whose = '**not seen**'
    else:
        named = joint is not None and joint in states[0]
        whose = 'named' if named else 'undetermined' if 'undetermined' in states[0] else 'silent'
    if after.any() and kind != 'jump' and error[after].max() > 3.0 * HEALTHY_DEG:
        whose += f', later {error[after].max():.2f}°'
    return f'{int(before.sum())}{worst}, {whose}'


def table(chain: Chain) -> list[str]:
    """Return the lines of the fault table; progress goes to stderr."""
    cases = [(f'{label}, {joint}', kind, joint, f'{kind}:{joint}@{START}+{DURATION}{value}')
             for label, kind, value in ONE_SENSOR for joint in FAULTY]
    cases += [(label, kind, None, f'{kind}@{START}+{DURATION}{value}')
              for label, kind, value in WHOLE_BUS]
    lines = ['| fault | ' + ' | '.join(PLACES) + ' |', '|---' * (1 + len(PLACES)) + '|']
    done, begun = 0, time.monotonic()
    for label, kind, joint, fault in cases:
        cells = []
        for place in PLACES.values():
            chain.play(place, START + DURATION + AFTER, fault)
            cells.append(judge(chain, place, kind, joint))
            done += 1
            print(f'{done}/{len(cases) * len(PLACES)} {time.monotonic() - begun:.0f} s: {label}: '
                  f'{cells[-1]}', file=sys.stderr, flush=True)
        lines.append(f'| {label} | ' + ' | '.join(cells) + ' |')
    return lines


def false_alarms(chain: Chain) -> list[str]:
    """Return the lines of the table of healthy running."""
    lines = ['| healthy running | samples | kept back | alarms |', '|---|---|---|---|']
    for label, place in HEALTHY.items():
        chain.play(place, HEALTHY_SECONDS)
        alarms = [m.data for _, m in chain.states if m.data.startswith(('silent', 'degraded'))
                  and 'no joint samples' not in m.data]
        out = {stamp(message) for _, message in chain.orientations}
        # The last sample's orientation may still be on its way.
        kept = sum(stamp(message) not in out and stamp(message) < max(out)
                   for _, message in chain.samples)
        lines.append(f'| {label} | {len(chain.samples)} | {kept} | {len(alarms)} |')
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def main() -> int:
    """Print the tables, and write them to the file named."""
    chain = Chain()
    try:
        lines = [*table(chain), '', *false_alarms(chain)]
    finally:
        chain.close()
    print('\n'.join(lines))
    if len(sys.argv) > 1:
        with open(sys.argv[1], 'w') as file:
            file.write('\n'.join(lines) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
