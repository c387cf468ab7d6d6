# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What happens before the first torque: read back, set the mode, and prove that the drives fall out.

Nothing here waits: each step of the samples takes the start-up one step further.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from math import inf

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import mode_words, State
from spm_haptic_master.drives.drive import Drive, ENABLE_TIMEOUT
from spm_haptic_master.drives.drive_objects import drive_objects
from spm_haptic_master.drives.plan import Plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import SetupError

# Longest wait for the answer to a request by SDO (s), and number of requests.
ANSWER_TIMEOUT, REQUESTS = 0.2, 3
# Time in which a drive has to disable its motor after the last frame, against the configured one
# (unit 1): its own grid of time, and the frames on their way.
FALL_OUT_FACTOR = 2.0
# Time for which a drive is watched longer than that (s), so that its real time can be reported.
WATCHED = 0.3
# Number of proofs of which one has to be in time: this machine may be late itself.
PROOFS = 3
# States without torque, which a drive has to fall into.
WITHOUT_TORQUE = (State.DISABLED, State.READY, State.SWITCHED_ON, State.FAULT)

# Steps, each of which waits for the next sample.
Steps = Generator[None, None, None]


class StartUp:
    """Start-up of all drives, one step a sample; `send` sends one frame and raises nothing."""

    def __init__(self, plan: Plan, drives: tuple[Drive, ...],
                 send: Callable[[can.Message], object]):
        self._plan, self._drives, self._send = plan, drives, send
        # Whether torque frames, of zero torque, and heartbeats go out, with resets of faults;
        # whether Operation enabled is wanted; what it waits for, in words, where that may last.
        self.sends = self.operate = False
        self.waits: str | None = None
        self._now = 0.0
        self._steps = self._run()

    def advance(self, now: float) -> bool:
        """
        Go as far as possible at a time, s; return whether all is done.

        SetupError: a drive is not as configured, or does not fall out: no torque.
        """
        self._now = now
        return next(self._steps, self) is self

    def _run(self) -> Steps:
        for drive in self._drives:
            yield from self._read_back(drive)
        for drive in self._drives:
            yield from self._set_mode(drive)
        yield from self._prove()
        yield from self._reach(State.DISABLED)

    def _read_back(self, drive: Drive) -> Steps:
        """Compare all objects of a drive with what they have to be; wait for one that is off."""
        while True:
            try:
                profile = yield from self._read(drive, canopen.DEVICE_TYPE)
                break
            except SetupError as error:
                self.waits = str(error)
        self.waits = None
        if profile is None or profile & 0xFFFF != canopen.DRIVE_PROFILE:
            shown = 'none' if profile is None else f'0x{profile:08X}'
            raise SetupError(f'{drive.own.name}: device type {shown}; expected a drive (profile '
                             f'{canopen.DRIVE_PROFILE})')
        found = []
        for wanted in drive_objects(self._plan, drive.own).every:
            value = yield from self._read(drive, (wanted.index, wanted.subindex))
            if not wanted.holds(value):
                found.append(wanted.difference(value))
        if found:
            raise SetupError(f'{drive.own.name}: {"; ".join(found)} (can_setup --write)')

    def _set_mode(self, drive: Drive) -> Steps:
        """Set the mode of operation: the configured one, or the first that the drive has."""
        modes = [self._plan.mode]
        if not self._plan.mode:
            modes = [cia402.CYCLIC_TORQUE, cia402.PROFILE_TORQUE]
            supported = yield from self._read(drive, cia402.SUPPORTED_MODES)
            if supported is not None:
                modes = [mode for mode in modes if supported >> (mode - 1) & 1]
        for mode in modes:
            answer = yield from self._request(
                drive, canopen.sdo_write(drive.own.node_id, *cia402.MODE, mode, 1), cia402.MODE)
            if answer[0] == canopen.SDO_DOWNLOAD_ANSWER:
                drive.mode = mode
                return
        raise SetupError(f'{drive.own.name}: no mode of operation 0x6060 of torque; expected '
                         f'{mode_words(cia402.CYCLIC_TORQUE)} or '
                         f'{mode_words(cia402.PROFILE_TORQUE)}')

    def _prove(self) -> Steps:
        """Pause all frames at zero torque: each drive has to leave Operation enabled in time."""
        plan = self._plan
        limit = FALL_OUT_FACTOR * (
            (plan.event_timer or plan.heartbeat_timeout) + plan.status_period)
        for _ in range(PROOFS):
            yield from self._reach(State.DISABLED)
            yield from self._reach(State.ENABLED)
            began, self.sends = self._now, False
            # Time without frames after which each drive was without torque, s.
            times = dict.fromkeys(self._drives, inf)
            while self._now - began <= limit + WATCHED and inf in times.values():
                for drive in [each for each, time in times.items() if time == inf]:
                    # By SDO: a drive that loses its heartbeat may end its status frames.
                    word = yield from self._read(drive, cia402.STATUSWORD)
                    if word is not None and cia402.state_of(word) in WITHOUT_TORQUE:
                        times[drive] = self._now - began
            drive, longest = max(times.items(), key=lambda item: item[1])
            if longest <= limit:
                return
        took = 'did not leave Operation enabled' if longest == inf else \
            f'left Operation enabled after {1e3 * longest:.0f} ms'
        raise SetupError(
            f'{drive.own.name} {took} without frames of this master; expected within '
            f'{1e3 * limit:.0f} ms by its event timer (0x1400:05), heartbeat (0x1016) and abort '
            'option (0x6007): no torque without that')

    def _reach(self, state: State) -> Steps:
        """Bring all drives into Operation enabled, or out of it, with what was a fault reset."""
        if not self.sends:
            for drive in self._drives:
                self._send(canopen.nmt(canopen.NMT_START, drive.own.node_id))
        asked, self.sends, self.operate = self._now, True, state is State.ENABLED
        while waiting := [drive for drive in self._drives
                          if drive.status_at <= asked or drive.state is not state]:
            if self._now - asked > ENABLE_TIMEOUT:
                drive = waiting[0]
                shown = 'no status frame' if drive.status_at <= asked else drive.state.value
                cause = f' ({drive.emergency})' if drive.emergency else ''
                raise SetupError(f'{drive.own.name}: {shown} {ENABLE_TIMEOUT:g} s after its '
                                 f'start{cause}; expected {state.value}')
            yield
        # What the pause has caused is over.
        for drive in self._drives:
            drive.restart()

    def _read(self, drive: Drive, key: tuple[int, int]) -> Generator[None, None, int | None]:
        """Return the value of an object; None if the drive does not give it."""
        answer = yield from self._request(
            drive, canopen.sdo_upload(drive.own.node_id, *key), key)
        return canopen.sdo_value(answer)

    def _request(self, drive: Drive, message: can.Message,
                 key: tuple[int, int]) -> Generator[None, None, bytes]:
        """Return the answer to a request by SDO; SetupError if none comes."""
        for _ in range(REQUESTS):
            drive.answer = None
            self._send(message)
            until = self._now + ANSWER_TIMEOUT
            while self._now < until:
                yield
                answer = drive.answer
                if answer is not None and canopen.sdo_object(answer) == key:
                    return answer
        raise SetupError(f'{drive.own.name} does not answer SDO 0x{key[0]:04X}:{key[1]:02X}')
