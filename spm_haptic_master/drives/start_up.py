# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The start-up of the drives, one step a sample: read back, set the mode, prove the fall-out.

The proof: the motors become free when the frames of this master stop.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from math import inf

import can
from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.cia402 import State
from spm_haptic_master.drives.drive import Drive, ENABLE_TIMEOUT, Steps
from spm_haptic_master.drives.passed_check import PassedCheck
from spm_haptic_master.drives.plan import Plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import SetupError

# Time in which a drive has to disable its motor after the last frame, against the configured one
# (unit 1): its own grid of time, and the frames on their way.
FALL_OUT_FACTOR = 2.0
# Time for which a drive is watched longer than that (s), so that its real time can be reported.
WATCHED = 0.3
# Number of proofs of which one has to be in time: this machine may be late itself.
PROOFS = 3
# Time after which a heartbeat of this master is no echo of one that was sent before (s).
ECHO = 0.05
# States without torque, which a drive has to fall into.
WITHOUT_TORQUE = (State.DISABLED, State.READY, State.SWITCHED_ON, State.FAULT)


class StartUp:
    """
    One start-up of all drives.

    Parameters
    ----------
    plan : Plan
        What is configured.
    drives : sequence of Drive
        In the order of the motors; the caller passes them frames and time.
    check : PassedCheck or None
        Check that the drives must be those of; None before there is one.
    send : callable
        Sends one frame.

    Attributes
    ----------
    goal : State or None
        ENABLED or DISABLED, where the caller's controlwords are to lead with zero torque; None: it
        sends none.

    """

    def __init__(
        self,
        plan: Plan,
        drives: Sequence[Drive],
        check: PassedCheck | None,
        send: Callable[[can.Message], None],
    ):
        self.goal: State | None = None
        self._plan = plan
        self._drives = drives
        self._check = check
        self._send = send
        self._began = inf
        self._has_other_master = False
        self._steps = self._run()

    def step(self) -> bool:
        """
        Advance by one step.

        Returns
        -------
        bool
            Whether it continues; False once all drives are proven.

        Raises
        ------
        SetupError
            A drive is not as it has to be.

        """
        try:
            next(self._steps)
        except StopIteration:
            return False
        return True

    def note_master(self) -> None:
        """Note a heartbeat of this master: before it sends any, another program does."""
        self._has_other_master |= self._now - self._began > ECHO

    @property
    def _now(self) -> float:
        """Time of the present sample, s, which all drives have."""
        return self._drives[0].now

    def _run(self) -> Steps:
        """Read the drives back, set their modes, and prove that they fall out."""
        self._began = self._now
        for drive in self._drives:
            yield from drive.read_back()
        if self._has_other_master:
            raise SetupError(
                f'another program sends the heartbeat of node {self._plan.master_id} '
                '(drives.master_id): end it, it commands the drives'
            )
        self._compare_identities()
        for drive in self._drives:
            yield from drive.set_mode()
        yield from self._prove()
        yield from self._reach(State.DISABLED)

    def _compare_identities(self) -> None:
        """Raise SetupError for a drive other than the one with its node id that was checked."""
        if self._check is None:
            return
        for index, drive in enumerate(self._drives):
            stranger = drive.identity and self._check.stranger(index, drive.identity)
            if stranger:
                raise SetupError(f'{drive.own.name}: {stranger}')

    def _prove(self) -> Steps:
        """
        Pause all frames at zero torque: each drive has to leave Operation enabled in time.

        One of PROOFS attempts has to be in time: within FALL_OUT_FACTOR times its configured
        time-out and a status period.

        Raises
        ------
        SetupError
            A drive stays enabled or leaves too late, has booted, or does not answer.

        """
        plan = self._plan
        limit = FALL_OUT_FACTOR * (
            (plan.event_timer or plan.heartbeat_timeout) + plan.status_period
        )
        for _ in range(PROOFS):
            yield from self._reach(State.DISABLED)
            yield from self._reach(State.ENABLED)
            self.goal = None
            times = yield from self._fall_out_times(limit + WATCHED)
            self._refuse_booted()
            drive, longest = max(times.items(), key=lambda item: item[1])
            if longest <= limit:
                return
        took = (
            'did not leave Operation enabled'
            if longest == inf
            else f'left Operation enabled after {1e3 * longest:.0f} ms'
        )
        raise SetupError(
            f'{drive.own.name} {took} without frames of this master; expected within '
            f'{1e3 * limit:.0f} ms by its event timer (0x1400:05), heartbeat (0x1016) and abort '
            'option (0x6007): no torque without that'
        )

    def _fall_out_times(self, longest: float) -> Generator[None, None, dict[Drive, float]]:
        """
        Return the time after which each drive is without torque.

        Parameters
        ----------
        longest : float
            Time for which they are watched, s.

        Returns
        -------
        dict of Drive to float
            Time in s; inf for a drive that is still enabled.

        """
        began = self._now
        times = dict.fromkeys(self._drives, inf)
        while self._now - began <= longest and inf in times.values():
            for drive in [drive for drive, time in times.items() if time == inf]:
                # By SDO: a drive that loses its heartbeat may end its status frames.
                word = yield from drive.sdo.read(cia402.STATUSWORD)
                if word is not None and cia402.state_of(word) in WITHOUT_TORQUE:
                    times[drive] = self._now - began
        return times

    def _reach(self, state: State) -> Steps:
        """
        Bring all drives into Operation enabled, or out of it, and reset their faults.

        Each must confirm it by a status frame of its own within ENABLE_TIMEOUT.

        Parameters
        ----------
        state : State
            ENABLED or DISABLED.

        Raises
        ------
        SetupError
            A drive is late, has booted, or deviates from its command.

        """
        if self.goal is None:
            for drive in self._drives:
                self._send(canopen.nmt(canopen.NMT_START, drive.own.node_id))
        asked = self._now
        self.goal = state
        while True:
            self._refuse_booted()
            waiting = self._waiting(asked, state)
            if waiting and self._now - asked > ENABLE_TIMEOUT:
                raise SetupError(self._late(waiting[0], asked, state))
            if state is State.ENABLED:
                self._refuse_deviations()
            if not waiting:
                break
            yield
        # What the pause has caused is over.
        for drive in self._drives:
            drive.clear()

    def _waiting(self, asked: float, state: State) -> list[Drive]:
        """Return the drives that have not reported a state since a time, s."""
        return [
            drive for drive in self._drives if drive.status_at <= asked or drive.state is not state
        ]

    def _late(
        self,
        drive: Drive,
        asked: float,
        state: State,
    ) -> str:
        """Return in words that a drive did not reach a state that was asked for at a time, s."""
        if drive.status_at <= asked:
            shown = 'no status frame'
        else:
            shown = drive.state.value
        cause = f' ({drive.emergency})' if drive.emergency else ''
        return (
            f'{drive.own.name}: {shown} {ENABLE_TIMEOUT:g} s after its start{cause}; expected '
            f'{state.value}'
        )

    def _refuse_booted(self) -> None:
        """Raise SetupError for a drive that has booted since it was read back."""
        for drive in self._drives:
            if drive.booted:
                raise SetupError(
                    f'{drive.own.name} booted during the start-up: its settings are lost'
                )

    def _refuse_deviations(self) -> None:
        """Raise SetupError for another mode or torque on the way to Operation enabled."""
        for drive in self._drives:
            found = drive.deviation(operate=True)
            if found:
                raise SetupError(f'{drive.own.name}: {found}')
