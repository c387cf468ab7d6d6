# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Driver, forward model and diagnostics in one process, with a live status."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future

from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.console import Status
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm


def compose(done: Future, add: Callable[[Node], Node]) -> None:
    """Make the three nodes, each to take what the one before it gives; the driver last."""
    fkm, diagnostics, driver = add(Fkm()), add(Diagnostics()), add(EncoderDriver(done))
    _connect(driver, fkm, 'measured_js')
    _connect(fkm, diagnostics, 'orientation')
    Status(driver, fkm, diagnostics)


def _connect(giver: EncoderDriver | Fkm, taker: Fkm | Diagnostics, topic: str) -> None:
    """Hand over by a call, in the driver's thread; where the topic is remapped apart, by topic."""
    if giver.resolve_topic_name(topic) == taker.resolve_topic_name(topic):
        giver.listener = taker.take
    else:
        taker.subscribe()


def main(args: list[str] | None = None) -> int:
    """Run the three nodes as one process."""
    return runner.run('master', compose, args)
