# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Counts of samples from the statuses of the nodes: made, lost, missed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from spm_haptic_master.benchmark.observer import Status
from spm_haptic_master.benchmark.pipeline import PipelineError

# Age of a reported count (ns): the driver reads it up to this long before the status is stamped.
COUNT_UNCERTAIN = 300_000


def reported(statuses: Sequence[Status], entry: str, key: str) -> list[float]:
    """Return the values of a key in an entry of /diagnostics, in the order of the statuses."""
    return [float(values[key]) for _, name, values in statuses if name == entry and key in values]


def growth(statuses: Sequence[Status]) -> dict[str, int]:
    """Return by how much each count grew from the first status of its name to the last."""
    first: dict[str, dict[str, str]] = {}
    last: dict[str, dict[str, str]] = {}
    for _, name, values in statuses:
        first.setdefault(name, values)
        last[name] = values
    return {key: int(value) - int(first[name].get(key, '0'))
            for name, values in last.items() for key, value in values.items()
            if value.isdecimal() and first[name].get(key, '0').isdecimal()}


def count_samples(statuses: Sequence[Status], stamps: np.ndarray) -> tuple[int, int, int]:
    """
    Return samples made, samples lost and deadlines missed about the window.

    The driver reports its counts in statuses with a stamp. Between two of them it made as many
    samples as its count grew; those that arrived have stamps between the two.

    Parameters
    ----------
    statuses : sequence of (int, str, dict of str to str)
        Stamp (ns), name and values of each status.
    stamps : ndarray, shape (n,)
        Stamps of the orientations that arrived, ns.

    Raises
    ------
    PipelineError
        There are fewer than two statuses of the driver.

    """
    stamps = np.sort(stamps)
    reported = []
    for at, _, values in statuses:
        if 'sets' not in values:
            continue
        arrived = np.searchsorted(stamps, at)
        certain = arrived == np.searchsorted(stamps, at - COUNT_UNCERTAIN)
        reported.append((certain, int(values['sets']), int(arrived),
                         int(values.get('missed deadlines', 0))))
    # At high rates there is always a sample in between: a count may be one off.
    reported = [entry for entry in reported if entry[0]] or reported
    if len(reported) < 2:
        raise PipelineError('overloaded: the driver reported fewer than two counts of its samples')
    (_, *first), (_, *last) = reported[0], reported[-1]
    made, received, missed = (after - before for before, after in zip(first, last, strict=True))
    return made, max(0, made - received), missed
