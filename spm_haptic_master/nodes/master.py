"""Driver, forward model and diagnostics in one process on one executor, with a live status."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from rclpy.task import Future

from spm_haptic_master.nodes import process
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.status import Status


def compose(done: Future, add: Callable[[Node], Node]) -> None:
    """Make the three nodes; the driver last, so that its first sample finds the others there."""
    fkm = add(Fkm())
    diagnostics = add(Diagnostics())
    Status(add(EncoderDriver(done)), fkm, diagnostics)


def main(args: list[str] | None = None) -> int:
    """Run the three nodes as one process."""
    return process.run('master', compose, args)
