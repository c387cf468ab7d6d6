# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bus by the script, on a clock that only the test moves, and frames to put on it."""

import can
from encoder_frames import answer, sync, T0
from spm_haptic_master.encoders import canopen

# s that a wait takes at least: a clock that stood still would never end one of no length.
TICK = 1e-6
# Longest wait to send, s.
SEND_TIMEOUT = 0.01


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


class ScriptedBus:
    """
    A bus on which frames come at the times of a script.

    An exception in the script is raised instead. Sending raises `refusal` where there is one.
    """

    def __init__(self, clock, script=()):
        self.clock = clock
        self.script = sorted(script, key=lambda entry: entry[0])
        self.sent = []
        self.refusal = None
        self.shut = 0
        self.waits = []

    def recv(self, timeout):
        assert timeout >= 0.0
        self.waits.append(timeout)
        if not self.script or self.script[0][0] > self.clock.now + timeout:
            self.clock.now += max(timeout, TICK)
            return None
        at, what = self.script.pop(0)
        self.clock.now = max(self.clock.now, at)
        if isinstance(what, Exception):
            raise what
        return what

    def send(self, message, timeout=None):
        assert timeout == SEND_TIMEOUT
        if self.refusal is not None:
            raise self.refusal
        self.sent.append((self.clock.now, message))

    def shutdown(self):
        self.shut += 1


def cycles(begin, count, without=()):
    """Return a script of SYNC and answers, the first at `begin` s."""
    script = []
    for start in (begin + 0.01 * number for number in range(count)):
        script.append((start, sync(T0 + start)))
        script += [
            (at := start + 1e-4 * (index + 1), answer(index, T0 + at))
            for index in range(4)
            if index not in without
        ]
    return script


def error_frame(at, identifier):
    return (
        at,
        can.Message(
            arbitration_id=identifier,
            is_error_frame=True,
            is_extended_id=False,
            timestamp=T0 + at,
            data=bytes(8),
        ),
    )


def node_frame(at, identifier, data):
    return (at, canopen.frame(identifier, data, T0 + at))


def opening_of(script):
    """Return a producer's function for the SYNCs of a script, and the script without them."""
    openings = [message.timestamp for _, message in script if message.arbitration_id == 0x80]

    def opening(stamp):
        due = [each for each in openings if each <= stamp]
        del openings[: len(due)]
        return due

    return opening, [each for each in script if each[1].arbitration_id != 0x80]


def run(source, until):
    """Read until a time; return the sets."""
    got = []
    while source.clock.now < until - 1e-9:
        sample = source.read(until - source.clock.now)
        if sample is not None:
            got.append(sample)
    return got
