# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Driver, forward model, diagnostics and teleop in one process, with a live status."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.task import Future
from spm_haptic_master.drives.plan import check_shared_bus
from spm_haptic_master.nodes.console import Console
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.teleop import Teleop
from spm_haptic_master.parameters.nodes import MASTER_SETTINGS
from spm_haptic_master.parameters.resolver import check_agreement
from spm_haptic_master.ros import runner

# What a second master must not publish: it would silence the first.
OWNED = {'fkm': 'orientation', 'encoder_driver': 'measured_js'}


def compose(done: Future, add: runner.AddNode) -> None:
    """Make and connect the nodes; the driver last, because it is destroyed first."""
    fkm = add(Fkm)
    teleop = add(Teleop) if fkm.declare(MASTER_SETTINGS)['teleop.run'] else None
    diagnostics, driver = add(Diagnostics), add(EncoderDriver, done)
    check_agreement({node.get_name(): node.values for node in (
        driver, fkm, diagnostics, *([] if teleop is None else [teleop]))})
    if fkm.force_state is not None and driver.source_name == 'can':
        # Encoders and drives on one bus.
        check_shared_bus(fkm.values, driver.values)
    if _is_one_topic('measured_js', driver, fkm):
        driver.listener = fkm.take
    fkm.driver_overload = lambda: driver.overload.words
    # The command of a slave goes out first.
    fkm.followers = [each.take for each in (teleop, diagnostics)
                     if each is not None and _is_one_topic('orientation', fkm, each)]
    Console(driver, fkm, diagnostics)


def _is_one_topic(topic: str, publisher: Node, subscriber: Fkm | Diagnostics | Teleop) -> bool:
    """Return whether a plain call replaces a topic; subscribe where one of the two remaps it."""
    if publisher.resolve_topic_name(topic) == subscriber.resolve_topic_name(topic):
        return True
    subscriber.subscribe()
    return False


def main(args: list[str] | None = None) -> int:
    """Run the nodes as one process."""
    return runner.run('master', compose, args, OWNED)
