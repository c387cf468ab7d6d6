"""Live encoders on any bus that python-can drives."""

from __future__ import annotations

import time

import can

from spm_haptic_master.encoders.assembler import SetAssembler
from spm_haptic_master.encoders.sample import EncoderSource, JointSample
from spm_haptic_master.exceptions import SettingError

# s between attempts to open a bus that is not there: doubled from the first to the last.
REOPEN_FIRST = 0.1
REOPEN_LAST = 2.0
# s without a set after which the bus counts as silent.
SILENCE = 0.05


class BusSource(EncoderSource):
    """
    Reads the four encoders from a CAN bus, in the caller's thread.

    A bus that is missing or breaks is opened again, with back-off; the reason stands in `fault`.

    Parameters
    ----------
    interface, channel : str
        As python-can names them ('socketcan' and 'can0' on a rig).
    bitrate : int
        bit/s, for interfaces that set it themselves; 0 leaves it to the system.
    assembler : SetAssembler
        The decoder.

    Raises
    ------
    SettingError
        python-can has no such interface.

    """

    def __init__(self, interface: str, channel: str, bitrate: int, assembler: SetAssembler):
        if interface not in can.VALID_INTERFACES:
            raise SettingError('can.interface', interface,
                               'one of ' + ', '.join(sorted(can.VALID_INTERFACES)))
        self._settings = {'interface': interface, 'channel': channel}
        if bitrate:
            self._settings['bitrate'] = bitrate
        self._assembler = assembler
        self._bus: can.BusABC | None = None
        self._broken: str | None = 'not opened yet'
        self._backoff = REOPEN_FIRST
        self._retry_at = 0.0
        self._opened = 0
        self._last_frame: float | None = None
        self._last_set: float | None = None

    def read(self, timeout: float) -> JointSample | None:
        """Return the next set that the bus completes within `timeout` seconds."""
        deadline = time.monotonic() + timeout
        while True:
            now = time.monotonic()
            if now > deadline:
                return None
            if self._bus is None and not self._open(now):
                time.sleep(max(0.0, min(self._retry_at, deadline) - now))
                continue
            try:
                message = self._bus.recv(deadline - now)
            except (can.CanError, OSError) as error:
                self._fail(error)
                continue
            if message is None:
                continue
            self._last_frame = time.monotonic()
            sample = self._assembler.feed(message)
            if sample is not None:
                self._last_set = self._last_frame
                return sample

    @property
    def fault(self) -> str | None:
        """Why no sets come: the bus, its silence, or what dropped the latest cycle."""
        if self._broken:
            return self._broken
        now = time.monotonic()
        if self._last_set is not None and now - self._last_set < SILENCE:
            return None
        if self._last_frame is None or now - self._last_frame > SILENCE:
            return f'no frames on {self._name}'
        return self._assembler.dropped or f'frames on {self._name}, but no set of four encoders'

    def statistics(self) -> dict[str, object]:
        """Return the decoder's counters and how often the bus was opened."""
        return {**self._assembler.counters, 'bus opened': self._opened}

    def close(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    @property
    def _name(self) -> str:
        return f'{self._settings["interface"]} {self._settings["channel"]}'

    def _open(self, now: float) -> bool:
        if now < self._retry_at:
            return False
        try:
            self._bus = can.Bus(**self._settings)
        except (can.CanError, OSError, ValueError, ImportError) as error:
            self._fail(error)
            return False
        self._assembler.reset()
        self._opened += 1
        self._broken = None
        self._backoff = REOPEN_FIRST
        return True

    def _fail(self, error: Exception) -> None:
        """Note the error, drop the bus, and set when to try again."""
        self._broken = f'{self._name}: {error}'
        self._retry_at = time.monotonic() + self._backoff
        self._backoff = min(2.0 * self._backoff, REOPEN_LAST)
        if self._bus is not None:
            try:
                self._bus.shutdown()
            except (can.CanError, OSError):
                pass  # it is broken already, and said so
            self._bus = None
