# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A clock that only the test moves."""

from encoder_frames import T0


class Clock:
    """Time that passes only in sleep; each sleep ends `late` s late."""

    def __init__(self):
        self.now = 0.0
        self.late = 0.0
        self.slept = []

    def monotonic(self):
        return 1000.0 + self.now

    def time(self):
        return T0 + self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds + self.late
