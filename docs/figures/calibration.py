# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw calibration_parity.png: what calibrate --motion leaves of a simulated rig's parity."""

from __future__ import annotations

from math import radians, tau
from pathlib import Path

import numpy as np
from spm_haptic_master.calibration import report_picture as figures
from spm_haptic_master.calibration.motion.free_motion import calibrate_motion
from spm_haptic_master.calibration.motion.model import Layout
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.noisy_motion import NoisyMotion
from spm_haptic_master.simulation.rig import random_rig, Tolerances

OUTPUT = Path(__file__).with_name('calibration_parity.png')
# The rig: seed, deviations (deg), counts per turn.
SEED = 3
DEVIATIONS = Tolerances(*map(radians, (0.3, 0.3, 0.12, 0.015)))
COUNTS = 16384
# The motion: length (s) and rate (Hz).
SECONDS, RATE = 60.0, 250.0


def main() -> None:
    """Simulate, calibrate and draw."""
    rig = random_rig(SEED, DEVIATIONS, noise=radians(0.04))
    motion = NoisyMotion(trajectories.hand, rig, SEED, (1, 1, 1))
    times = np.arange(int(SECONDS * RATE)) / RATE
    counts = np.round(np.array([motion.angles(t) for t in times.tolist()]) * COUNTS / tau)
    found = calibrate_motion(
        Layout(4), np.round(times * 1e9).astype(np.int64), counts * tau / COUNTS
    )
    OUTPUT.write_bytes(figures.draw(found))
    print(OUTPUT.name)


if __name__ == '__main__':
    main()
