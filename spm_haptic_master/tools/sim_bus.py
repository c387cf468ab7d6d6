# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plays four CANopen encoders on any bus that python-can drives: the package without hardware."""

from __future__ import annotations

import argparse
import time

import can

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.simulation.fault_injection import KINDS, parse_fault, SYNTAX
from spm_haptic_master.simulation.settings import make_motion, MOTION_SETTINGS
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.source_factory import SOURCE_SETTINGS
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Plays four encoders as the driver's parameters describe them: they boot, wait for NMT start, answer
SYNC, SDO identity requests, and send heartbeats. The motion is that of sim.trajectory, and begins
with the first answer."""
# s between looks at faults and heartbeats.
TEND_PERIOD = 0.002
# s; a receive time further back is that of a clock with another epoch.
LONGEST_WAIT = 0.1


def main(args: list[str] | None = None) -> int:
    """Run the simulated bus until Ctrl-C, or for the seconds asked for."""
    return command_line.run('sim_bus', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse_args(args)
    faults = tuple(map(parse_fault, options.fault))
    settings = tuple(dict.fromkeys((*SOURCE_SETTINGS['can'], *MOTION_SETTINGS)))
    values = command_line.checked(command_line.given(options), settings, 'sim', 'can')
    decoder = make_decoder(values)
    node_ids = values['encoders.node_id'] if decoder.network else None
    encoders = SimulatedBus(
        tuple(encoder.layout for encoder in decoder.encoders), node_ids, make_motion(values),
        faults, options.heartbeat, values['sim.seed'])
    grid = DeadlineGrid(1.0 / values['rate']) if options.sync or decoder.sync_id is None else None
    end = time.monotonic() + options.seconds if options.seconds else float('inf')
    with command_line.bus_of(values) as bus:
        player = Player(bus, encoders, decoder.sync_id, grid)
        player.send(encoders.boot())
        print(f'sim_bus: four encoders on {command_line.bus_name(values)}', flush=True)
        try:
            while time.monotonic() < end:
                player.step()
        finally:
            print(f'sim_bus: {player.cycles} cycles answered'
                  + (f', {grid.missed} deadlines missed' if grid else ''), flush=True)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_line.make_parser('sim_bus', DESCRIPTION)
    parser.add_argument('--sync', action='store_true',
                        help='make SYNC too, at `rate` (and answer no other)')
    parser.add_argument('--heartbeat', type=float, default=0.1, metavar='S',
                        help='s between heartbeats (default 0.1)')
    parser.add_argument('--seconds', type=float, metavar='S', help='end after so long')
    parser.add_argument('--fault', action='append', default=[], metavar='FAULT',
                        help=f'{SYNTAX}; may be repeated')
    kinds = '\n'.join(f'  {kind:9}{what}' + (f' (=VALUE, {unit})' if unit else '')
                      for kind, (what, unit) in KINDS.items())
    parser.epilog = f'faults:\n{kinds}\nexample: --fault offset:joint_3a@5+2=1.5'
    return parser


class Player:
    """
    Carries frames between a bus and the simulated encoders.

    Parameters
    ----------
    bus : can.BusABC
        The bus.
    encoders : SimulatedBus
        What answers.
    sync_id : int or None
        Identifier of SYNC; None: the encoders send by themselves.
    grid : DeadlineGrid or None
        When to make SYNC, or to send by themselves; None: SYNC comes from the bus.

    """

    def __init__(self, bus: can.BusABC, encoders: SimulatedBus, sync_id: int | None,
                 grid: DeadlineGrid | None):
        self._bus = bus
        self._encoders = encoders
        self._sync_id = sync_id
        self._sync = sync_id and canopen.frame(sync_id)
        self._grid = grid
        self.cycles = 0

    def step(self) -> None:
        """Do what is due next: a cycle, an answer, or heartbeats and faults."""
        if self._grid is not None:
            if self._grid.wait(TEND_PERIOD):
                now = time.monotonic()
                if self._sync:
                    self.send([self._sync])
                self._cycle(now)
            timeout = 0.0
        else:
            timeout = TEND_PERIOD
        while (message := self._bus.recv(timeout)) is not None:
            if message.arbitration_id == self._sync_id and not message.is_error_frame \
                    and not message.is_extended_id and not message.is_remote_frame:
                if self._grid is None:
                    # The encoders sample when SYNC comes, not when this process is woken by it.
                    waited = time.time() - message.timestamp
                    self._cycle(time.monotonic() - min(max(waited, 0.0), LONGEST_WAIT))
            else:
                self.send(self._encoders.receive(message))
            timeout = 0.0
        self.send(self._encoders.tend(time.monotonic()))
        for line in self._encoders.news:
            print(f'{time.time():.6f} {line}', flush=True)
        self._encoders.news.clear()

    def send(self, messages: list[can.Message]) -> None:
        """Send frames one after the other."""
        for message in messages:
            self._bus.send(message)

    def _cycle(self, now: float) -> None:
        answers = self._encoders.cycle(now)
        self.send(answers)
        self.cycles += bool(answers)
