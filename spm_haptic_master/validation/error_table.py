# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of the forward models against motion capture, and the CSV files of a validation."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import NamedTuple

import numpy as np
from spm_haptic_master.kinematics import zxz_from_matrix
from spm_haptic_master.validation.alignment import rotation_vectors
from spm_haptic_master.validation.comparison import Comparison, zxz_degrees

# Names of the ZXZ angles in both files.
ANGLES = ('psi', 'theta', 'phi')
# Header of errors.csv.
ERROR_COLUMNS = ('model', 'quantity', 'samples', 'missing', 'mean_deg', 'rms_deg', 'p95_deg',
                 'max_deg')


class ErrorRow(NamedTuple):
    """Errors of one quantity of one model."""

    model: str
    quantity: str  # psi, theta, phi or rotation (the angle of the whole rotation)
    samples: int  # orientations with an answer of the model
    missing: int  # orientations without one
    figures_deg: tuple[float, ...]  # mean error; rms, 95th percentile and maximum of its size


def error_table(comparison: Comparison) -> list[ErrorRow]:
    """Return the models' errors against the capture: psi, theta, phi and the rotation."""
    captured = zxz_from_matrix(comparison.captured)
    table = []
    for model, rotations in comparison.models.items():
        known = np.isfinite(rotations[:, 0, 0])
        if not known.any():
            continue
        errors = [np.angle(np.exp(1j * (angle - truth[known]))) for angle, truth in zip(
            zxz_from_matrix(rotations[known]), captured, strict=True)]
        errors.append(np.linalg.norm(rotation_vectors(
            rotations[known] @ comparison.captured[known].swapaxes(-1, -2)), axis=-1))
        for quantity, error in zip((*ANGLES, 'rotation'), errors, strict=True):
            size = np.degrees(np.abs(error))
            table.append(ErrorRow(
                model, quantity, int(known.sum()), int((~known).sum()), (
                    float(np.degrees(error.mean())), float(np.sqrt(np.mean(size**2))),
                    float(np.percentile(size, 95.0)), float(size.max()))))
    return table


def write_error_table(path: Path, table: list[ErrorRow]) -> None:
    """Write errors.csv."""
    with open(path, 'w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(ERROR_COLUMNS)
        for row in table:
            writer.writerow([*row[:-1], *(f'{value:.5f}' for value in row.figures_deg)])


def write_aligned(path: Path, comparison: Comparison) -> None:
    """Write aligned.csv: both clocks' times (s) and the ZXZ angles (deg) of capture and models."""
    tracks = {'captured': comparison.captured, **comparison.models}
    columns = [comparison.time, comparison.capture_time,
               *(column for rotations in tracks.values() for column in zxz_degrees(rotations))]
    header = ['time', 'capture_time',
              *(f'{name}_{angle}_deg' for name in tracks for angle in ANGLES)]
    np.savetxt(path, np.column_stack(columns), fmt='%.6f', delimiter=',',
               header=','.join(header), comments='')
