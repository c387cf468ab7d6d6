# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A model whose parity is linear in its parameters, so that numpy alone solves every fit of it."""

from types import SimpleNamespace

import numpy as np
from spm_haptic_master.calibration.motion.model import Linearised


class LinearModel:
    """
    Stands in for a MotionModel: the parity of a sample is A x - y, shape (K,).

    What the fit takes for readings are y and A of each sample: `samples_of` packs them. Samples
    with NaN have no orientation. `count` is the number of linearisations.
    """

    def __init__(
        self,
        layout,
        parities=1,
    ):
        self.layout = layout
        self._parities = parities
        self.count = 0

    def parts(self, turned):
        """Return y, shape (n, K), and A, shape (n, K, P), of samples."""
        unpacked = turned.reshape(len(turned), self._parities, -1)
        return unpacked[:, :, 0], unpacked[:, :, 1:]

    def linearised(
        self,
        turned,
        rotation,
        vector,
        columns=(),
    ):
        """Return the parity, and its derivatives by the parameters in `columns`."""
        self.count += 1
        y, rows = self.parts(turned)
        parity, slopes = self.parity(y, rows, vector)
        usable = np.isfinite(turned).all(axis=1)
        return Linearised(
            usable=usable,
            parity=np.where(usable[:, None], parity, 0.0),
            derivative=np.where(usable[:, None, None], slopes, 0.0)[:, :, list(columns)],
            rotation=rotation,
        )

    def parity(
        self,
        y,
        rows,
        vector,
    ):
        """Return the parity, and its derivatives by all parameters."""
        return rows @ vector - y, rows

    def orientations(
        self,
        turned,
        vector,
    ):
        """Return an orientation of each sample: none has a meaning."""
        return np.zeros((len(turned), 3, 3))


def samples_of(y, rows):
    """Return samples with y, shape (n, K), and A, shape (n, K, P), as readings."""
    return np.concatenate([y[:, :, None], rows], axis=2).reshape(len(y), -1)


def layout_of(deviations, sensors=4):
    """Return the part of a layout that a fit looks at."""
    return SimpleNamespace(deviations=np.asarray(deviations, dtype=float), sensors=sensors)


def no_rotation(samples):
    """Return orientations for samples where they do not count."""
    return np.zeros((len(samples), 3, 3))
