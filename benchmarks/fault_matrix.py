# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drive the real chain through every fault, at every place, and print what it published.

Simulated encoders on a bus (sim_bus), encoder_driver and fkm run as processes. A cell reports how
many orientations were published between the first wrong sample of the fault and the first withheld
one, the error of the worst of them, and whether fkm named the faulty sensor.

Run it with the package and its tests' requirements installed (make faults):
python -m benchmarks.fault_matrix [FILE.md]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import sys
import time

from spm_haptic_master.benchmark.child_process import (
    bus_channel,
    executable,
    parameter_arguments,
    private_environment,
    Program,
)

# The observer, too, is on the private domain; it comes from the tests' harness.
os.environ.update(private_environment())
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from geometry_msgs.msg import QuaternionStamped  # noqa: E402, I100
from harness import Observer, stamp  # noqa: E402
import numpy as np  # noqa: E402
from recording import quaternions, rotation_angle  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from spm_haptic_master.joints import JOINT_NAMES  # noqa: E402
from spm_haptic_master.kinematics import (  # noqa: E402
    inverse,
    matrix_from_zxz,
    quaternion_from_matrix,
)
from spm_haptic_master.nodes.qos import STATE  # noqa: E402
from spm_haptic_master.parameter_files import simulated_rig  # noqa: E402
from std_msgs.msg import String  # noqa: E402

BUS = {'can.interface': 'udp_multicast', 'can.channel': bus_channel()}
# Noise of each simulated encoder, standard deviation (deg).
NOISE_DEG = 0.04
# Beginning of the fault, its length, and the time observed after it (s).
START, DURATION, AFTER = 1.3, 0.5, 0.1
# Error of an orientation from four healthy sensors at these places, rms (deg): bound of first
# order.
HEALTHY_DEG = 0.06
# Time for the nodes to start and find each other, and for the first sample (s).
START_TIMEOUT, SAMPLE_TIMEOUT = 20.0, 15.0

# psi and theta of the centre of the workspace (deg).
CENTRE = (135.0, 54.735610317)
# Motions of the encoders, by column of the table.
PLACES = {
    'centre': {'sim.trajectory': 'fixed', 'sim.pose_deg': [*CENTRE, 20.0]},
    'edge': {'sim.trajectory': 'fixed', 'sim.pose_deg': [115.0, 45.0, 25.0]},
    'singular': {'sim.trajectory': 'fixed', 'sim.pose_deg': [*CENTRE, 49.358591780]},
    'crossing': {'sim.trajectory': 'fig9'},
}
# Sensors that become faulty.
FAULTY = (JOINT_NAMES[1], JOINT_NAMES[3])
# Label, kind and value of each fault of one sensor.
ONE_SENSOR = (
    ('step of 0.5 deg', 'offset', '=0.5'), ('step of 1 deg', 'offset', '=1'),
    ('step of 5 deg', 'offset', '=5'), ('one sample off by 5 deg', 'jump', '=5'),
    ('stuck', 'stuck', ''), ('noise of 0.5 deg', 'noise', '=0.5'), ('no answers', 'dropout', ''),
    ('node reboots', 'reboot', ''),
)
# Label, kind and value of each fault of the whole bus.
WHOLE_BUS = (('bus silent', 'silence', ''), ('bus off', 'busoff', ''))
# Motions without a fault, by label.
HEALTHY = {
    'rest': PLACES['centre'], 'rest at the singularity': PLACES['singular'],
    'slow (Fig. 9)': PLACES['crossing'],
    'moving (sweep)': {'sim.trajectory': 'sweep', 'sim.tilt_max_deg': 20.0},
}
# Length of each healthy run (s).
HEALTHY_SECONDS = 20.0

Place = Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Cell:
    """
    A cell of the fault table.

    Attributes
    ----------
    label : str
        Row of the table.
    place : str
        Column of the table, a key of `PLACES`.
    kind : str
        Kind of the fault, as in `sim_bus --fault`.
    joint : str or None
        Faulty joint; None for the whole bus.
    fault : str
        The argument of `sim_bus --fault`.

    """

    label: str
    place: str
    kind: str
    joint: str | None
    fault: str


def cells() -> Iterator[Cell]:
    """Yield the cells row by row."""
    for label, kind, value in ONE_SENSOR:
        for joint in FAULTY:
            for place in PLACES:
                yield Cell(f'{label}, {joint}', place, kind, joint,
                           f'{kind}:{joint}@{START}+{DURATION}{value}')
    for label, kind, value in WHOLE_BUS:
        for place in PLACES:
            yield Cell(label, place, kind, None, f'{kind}@{START}+{DURATION}{value}')


def truth(place: Place, t: np.ndarray) -> np.ndarray:
    """Return the true ZXZ angles, deg, (n, 3), at times s into the motion."""
    if place['sim.trajectory'] == 'fig9':
        phi = 45.0 + 10.0 * np.sin(np.pi * t / 10.0)
        return np.column_stack([np.full_like(t, CENTRE[0]), np.full_like(t, CENTRE[1]), phi])
    return np.broadcast_to(place['sim.pose_deg'], (len(t), 3))


class Chain:
    """
    encoder_driver and fkm on a bus, and an observer of what they publish.

    Attributes
    ----------
    observer : Observer
        Subscriber of all.
    samples, orientations, states : list of (int, message)
        Messages of the latest run with their times of arrival, ns.

    """

    def __init__(self) -> None:
        self.observer = Observer()
        self.samples = self.observer.collect(JointState, 'measured_js')
        self.orientations = self.observer.collect(QuaternionStamped, 'orientation')
        self.states = self.observer.collect(String, 'state', STATE)
        self._driver = Program(executable(
            'encoder_driver', parameters={'source': 'can', **simulated_rig(), **BUS}))
        self._fkm: Program | None = None

    def play(self, place: Place, seconds: float, *faults: str) -> None:
        """Run the encoders for some seconds, with an fkm that has just been started."""
        if self._fkm is not None:
            self._fkm.stop()
        self._fkm = Program(executable('fkm'))
        node = self.observer.node
        if not self.observer.spin_until(
                lambda: node.count_publishers('measured_js')
                and node.count_publishers('orientation')
                and node.count_subscribers('measured_js') > 1, START_TIMEOUT):
            raise RuntimeError('encoder_driver or fkm did not start: '
                               + self._driver.stderr + self._fkm.stderr)
        self.observer.spin(0.5)
        for arrived in (self.samples, self.orientations, self.states):
            arrived.clear()
        arguments = ['--sync', '--seconds', str(seconds + 2.0),
                     *parameter_arguments({**BUS, **place, 'sim.noise_deg': NOISE_DEG})]
        for fault in faults:
            arguments += ['--fault', fault]
        with Program(executable('sim_bus', *arguments)) as bus:
            if not self.observer.spin_until(lambda: self.samples, SAMPLE_TIMEOUT):
                raise RuntimeError(f'no joint samples: {bus.stdout} {bus.stderr}')
            self.observer.spin(seconds)
        if not self.orientations:
            raise RuntimeError(f'no orientation of {len(self.samples)} samples: '
                               f'{[m.data for _, m in self.states]} {self._fkm.stderr}')

    def close(self) -> None:
        """Stop all programs."""
        for program in filter(None, (self._fkm, self._driver)):
            program.stop()
        self.observer.close()


def onset(kind: str, joint: str | None, place: Place, times: np.ndarray,
          positions: np.ndarray) -> float:
    """Return the time, s, of the first sample that the fault made wrong."""
    if joint is None or kind in ('dropout', 'reboot'):
        return START
    index = JOINT_NAMES.index(joint)
    joints = inverse(matrix_from_zxz(*np.radians(truth(place, times)).T))
    true = np.column_stack([joints.theta1, joints.theta3a])[:, index]
    late = times > START - 0.05
    if kind == 'stuck':
        wrong = np.zeros(len(times), bool)
        wrong[:-8] = [len(set(positions[i:i + 9, index])) == 1 for i in range(len(times) - 8)]
    else:
        wrong = np.degrees(np.abs(positions[:, index] - true)) > 6.0 * NOISE_DEG
    found = np.flatnonzero(wrong & late)
    return float(times[found[0]]) if len(found) else START


def evaluate(chain: Chain, cell: Cell) -> str:
    """Return the text of a cell after its run."""
    place = PLACES[cell.place]
    sampled = np.array([stamp(message) for _, message in chain.samples])
    positions = np.array([message.position for _, message in chain.samples])
    since_first = (sampled - sampled[0]) * 1e-9
    begin = onset(cell.kind, cell.joint, place, since_first, positions)
    out = np.array([stamp(message) for _, message in chain.orientations])
    t = (out - sampled[0]) * 1e-9
    true = quaternion_from_matrix(matrix_from_zxz(*np.radians(truth(place, t)).T))
    error = rotation_angle(quaternions(chain.orientations), true)
    during = (t >= begin) & (t < START + DURATION)
    # Samples of the fault without an orientation: the first of them is the detection.
    withheld = np.setdiff1d(
        sampled[(since_first >= begin) & (since_first < START + DURATION)], out)
    detected = withheld[0] if len(withheld) else np.iinfo(np.int64).max
    before, after = during & (out < detected), during & (out > detected)
    worst = f', {error[before].max():.2f}°' if before.any() else ''
    states = [m.data for _, m in chain.states if m.data not in ('starting', 'healthy')]
    if cell.kind == 'jump':
        result = 'withheld' if len(withheld) else ('detected' if states else '**passed**')
    elif not states:
        result = '**not detected**'
    else:
        named = cell.joint is not None and cell.joint in states[0]
        result = 'named' if named else 'undetermined' if 'undetermined' in states[0] else 'silent'
    if after.any() and cell.kind != 'jump' and error[after].max() > 3.0 * HEALTHY_DEG:
        result += f', later {error[after].max():.2f}°'
    return f'{int(before.sum())}{worst}, {result}'


def fault_table(chain: Chain, chosen: Sequence[Cell]) -> list[str]:
    """Return the lines of the fault table; print the progress on standard error."""
    rows: dict[str, list[str]] = {}
    begun = time.monotonic()
    for done, cell in enumerate(chosen, start=1):
        chain.play(PLACES[cell.place], START + DURATION + AFTER, cell.fault)
        rows.setdefault(cell.label, []).append(evaluate(chain, cell))
        elapsed = time.monotonic() - begun
        left = elapsed / done * (len(chosen) - done)
        print(f'{done} of {len(chosen)}, {elapsed:.0f} s, {left:.0f} s left: {cell.label}, '
              f'{cell.place}: {rows[cell.label][-1]}', file=sys.stderr, flush=True)
    return ['| fault | ' + ' | '.join(PLACES) + ' |', '|---' * (1 + len(PLACES)) + '|',
            *(f'| {label} | ' + ' | '.join(texts) + ' |' for label, texts in rows.items())]


def false_alarms(chain: Chain) -> list[str]:
    """Return the lines of the table of healthy running; print the progress on standard error."""
    lines = ['| healthy running | samples | withheld | alarms |', '|---|---|---|---|']
    for label, place in HEALTHY.items():
        print(f'healthy running for {HEALTHY_SECONDS:g} s: {label} ...', file=sys.stderr,
              flush=True)
        chain.play(place, HEALTHY_SECONDS)
        alarms = [m.data for _, m in chain.states if m.data.startswith(('silent', 'degraded'))
                  and 'no joint samples' not in m.data]
        out = {stamp(message) for _, message in chain.orientations}
        # The orientation of the last sample may not have arrived yet.
        withheld = sum(stamp(message) not in out and stamp(message) < max(out)
                       for _, message in chain.samples)
        lines.append(f'| {label} | {len(chain.samples)} | {withheld} | {len(alarms)} |')
        print(lines[-1], file=sys.stderr, flush=True)
    return lines


def main() -> int:
    """Print the tables; write them to the file that the command line names."""
    chain = Chain()
    try:
        lines = [*fault_table(chain, list(cells())), '', *false_alarms(chain)]
    finally:
        chain.close()
    print('\n'.join(lines))
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text('\n'.join(lines) + '\n', encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
