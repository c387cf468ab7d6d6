# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A clock that only the test moves."""

from encoder_frames import T0

# s that a wait takes at least: a clock that stood still would never end one of no length.
TICK = 1e-6


class Clock:
    """Time that passes only in sleep; each sleep ends `late` s late."""

    def __init__(self):
        self.now = self.late = 0.0
        self.slept = []

    def monotonic(self):
        return 0.5 + self.now

    def time(self):
        return T0 + self.now

    def time_ns(self):
        return round(T0) * 10**9 + round(self.now * 1e9)

    def sleep(self, seconds):
        assert seconds >= 0.0
        self.slept.append(seconds)
        self.now += max(seconds, TICK) + self.late
