# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Section 5's experiment on simulated hardware: calibration, recording, motion capture, validation.

`sim_bus` simulates the encoders on a CAN bus between processes; `calibrate`, `encoder_driver`,
`fkm`, `recorder` and `validate` are the programs of a rig. Only the motion capture is simulated
here: four markers, their placement and their noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
import csv
from dataclasses import dataclass
from pathlib import Path
import signal
import time

from benchmarks.pipeline.child_process import (
    bus_channel,
    executable,
    parameter_arguments,
    Program,
    wait_until,
)
import numpy as np
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics import matrix_from_zxz
from spm_haptic_master.parameters.files import read_sections, simulated_rig
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.validation import recordings

# Rate of the samples (Hz): low enough for the whole chain of processes on a busy machine.
RATE = 250.0
# Rate of the motion capture (Hz), usual for a rig.
CAPTURE_RATE = 100.0
# Longest times until the first samples are on disk, and until a program has ended (s).
START_LIMIT, END_LIMIT = 60.0, 20.0
# Length of calibrate's recording (s).
CALIBRATION_SECONDS = 2.0
# Poses of the jig: psi, theta, phi (deg), the workspace's centre, and one that turns every joint
# by more than 5 deg from there. A single pose determines no direction.
JIG = (135.0, 54.735610317, 0.0), (120.0, 50.0, 20.0)

# Markers in the platform's frame (mm): A and B on Z_E, C and D opposite each other beside it.
MARKERS = np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 140.0], [60.0, 0.0, 90.0], [-60.0, 0.0, 90.0]])
# Azimuths of the markers C and D about Z_E (rad).
AZIMUTHS = (0.0, np.pi)
# Standard deviations (mm) of a marker's constant place on the platform, and of a captured
# coordinate. With both, the error of the self-rotation stays below the paper's 1 deg.
PLACEMENT, CAPTURE_NOISE = 0.3, 0.25
# Seed of placement and noise.
SEED = 5
# Orientation of the base frame in the capture's frame, and its origin there (mm): `validate` is
# given neither.
FRAME = matrix_from_zxz(0.7, 0.4, -1.9)
ORIGIN = np.array([350.0, -120.0, 900.0])


@dataclass(frozen=True, slots=True)
class Experiment:
    """
    Recordings and results of the experiment.

    Attributes
    ----------
    joints : Track
        Recorded joint angles, rad.
    truth : ndarray, shape (n, 3, 3)
        Imposed orientations at the captured times, R_base_platform.
    coordinates : ndarray, shape (n, 12)
        Coordinates of the captured markers, mm.
    aligned : dict of str to ndarray
        Columns of aligned.csv.
    errors : list of dict
        Rows of errors.csv.

    """

    joints: recordings.Track
    truth: np.ndarray
    coordinates: np.ndarray
    aligned: dict[str, np.ndarray]
    errors: list[dict[str, str]]


def _bus() -> dict[str, object]:
    """Return the parameters of this process's own simulated CAN bus."""
    return {
        'can.interface': 'udp_multicast',
        'can.channel': bus_channel(),
        'can.sync': 'produce',
        'rate': RATE,
    }


@contextmanager
def _running(*commands: Sequence[str]) -> Iterator[list[Program]]:
    """Keep programs running; end them in the opposite order."""
    programs: list[Program] = []
    try:
        for command in commands:
            programs.append(Program(command))
        yield programs
    finally:
        for program in reversed(programs):
            with suppress(TimeoutError):  # it was killed
                program.stop(signal.SIGINT, END_LIMIT)


def _check_running(programs: Sequence[Program]) -> None:
    for program in programs:
        if program.poll() is not None:
            raise _failure(program)


def _finish(command: Sequence[str], limit: float) -> None:
    """Run a program to its end, which has to come within `limit` s."""
    program = Program(command)
    if program.wait(limit):
        raise _failure(program)


def _failure(program: Program) -> SpmError:
    """Return the error of a program that ended, with the last line that it printed."""
    lines = (program.stderr or program.stdout).strip().splitlines()
    return SpmError(
        f'{program.command[3]} ended with {program.poll()}: '
        + (lines[-1] if lines else 'without a message')
    )


def calibrate(directory: Path) -> dict[str, Values]:
    """
    Find zero counts and directions of the simulated encoders in a jig, as in Fig. 27.

    The calibration file goes into `directory`. Returned are the encoders' parameters: those
    'found' by `calibrate`, and the 'true' ones. SpmError if a program fails.
    """
    found = directory / 'calibration.yaml'
    for pose in JIG:
        with _running(
            executable(
                'sim_bus',
                *parameter_arguments(
                    {**_bus(), 'sim.trajectory': 'fixed', 'sim.pose_deg': list(pose)}
                ),
            )
        ) as programs:
            _wait_for_encoders(programs)
            # The second run replaces the file of the first one, and verifies the directions.
            _finish(
                executable(
                    'calibrate',
                    '-o',
                    str(found),
                    '--force',
                    '--pose',
                    *map(str, pose),
                    '--seconds',
                    str(CALIBRATION_SECONDS),
                    *parameter_arguments(_bus()),
                ),
                START_LIMIT,
            )
    return {'found': read_sections(found)[0].values, 'true': simulated_rig()}


def run(directory: Path, seconds: float) -> Experiment:
    """
    Record the perturbed motion through driver and forward model, capture it, and validate.

    The recordings, of some seconds, go into `directory`. SpmError if a program fails, or nothing
    was recorded.
    """
    recording = directory / 'recording'
    bus = _bus()
    with _running(
        executable('recorder', parameters={'directory': recording}),
        executable('fkm', parameters={'rate': RATE}),
        executable('sim_bus', *parameter_arguments({**bus, 'sim.trajectory': 'perturbed'})),
        executable('encoder_driver', parameters={'source': 'can', **simulated_rig(), **bus}),
    ) as programs:
        begin = time.monotonic()
        _wait_for_samples(recording / 'orientation.csv', programs)
        time.sleep(seconds)
        _check_running(programs)
        length = time.monotonic() - begin
    coordinates, truth = capture(length)
    times = np.arange(len(truth)) / CAPTURE_RATE
    np.savetxt(
        directory / 'markers.csv',
        np.column_stack([times, coordinates]),
        fmt='%.4f',
        delimiter=',',
        comments='',
        header=','.join(('time', *recordings.MARKERS)),
    )
    _finish(
        executable(
            'validate',
            str(recording / 'orientation.csv'),
            str(directory / 'markers.csv'),
            '--joints',
            str(recording / 'measured_js.csv'),
            '-o',
            str(directory / 'validation'),
        ),
        START_LIMIT,
    )
    aligned = np.genfromtxt(directory / 'validation' / 'aligned.csv', delimiter=',', names=True)
    columns = {name: aligned[name] for name in aligned.dtype.names}
    rows = np.round(columns['capture_time'] * CAPTURE_RATE).astype(int)
    with open(directory / 'validation' / 'errors.csv', newline='', encoding='utf-8') as file:
        errors = list(csv.DictReader(file))
    joints = recordings.read_joints(recording / 'measured_js.csv', '')
    if joints is None:
        raise SpmError('no joint angles were recorded')
    return Experiment(joints, truth[rows], coordinates[rows], columns, errors)


def _wait_for_encoders(programs: Sequence[Program]) -> None:
    def booted() -> bool:
        _check_running(programs)
        return 'four encoders' in programs[0].stdout

    if not wait_until(booted, START_LIMIT):
        raise SpmError(f'no simulated encoders within {START_LIMIT:g} s')


def _wait_for_samples(path: Path, programs: Sequence[Program]) -> None:
    def recorded() -> bool:
        _check_running(programs)
        return path.exists() and path.stat().st_size > 0

    if not wait_until(recorded, START_LIMIT):
        raise SpmError(f'no orientation within {START_LIMIT:g} s: is multicast possible here?')


def capture(seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Simulate the motion capture of the perturbed motion, from its beginning on.

    Returns
    -------
    coordinates : ndarray, shape (n, 12)
        Markers A, B, C, D, mm, in the capture's frame.
    truth : ndarray, shape (n, 3, 3)
        R_base_platform.

    """
    rng = np.random.default_rng(SEED)
    t = np.arange(0.0, seconds, 1.0 / CAPTURE_RATE)
    truth = matrix_from_zxz(*np.array([trajectories.perturbed(float(each)) for each in t]).T)
    placed = MARKERS + PLACEMENT * rng.normal(size=MARKERS.shape)
    points = ORIGIN + np.einsum('nij,kj->nki', FRAME @ truth, placed)
    points += CAPTURE_NOISE * rng.normal(size=points.shape)
    return points.reshape(len(t), -1), truth
