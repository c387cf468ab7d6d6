# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Driver, forward model, diagnostics and teleop in one process, with a live status."""

from __future__ import annotations

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
    _connect(driver, fkm, 'measured_js')
    fkm.driver_overload = lambda: driver.overload.words
    _connect(fkm, diagnostics, 'orientation')
    if teleop is not None:
        _connect_teleop(fkm, teleop)
    Console(driver, fkm, diagnostics)


def _connect(publisher: EncoderDriver | Fkm, subscriber: Fkm | Diagnostics, topic: str) -> None:
    """Connect by a plain call; by the topic where one of the two has it remapped."""
    if publisher.resolve_topic_name(topic) == subscriber.resolve_topic_name(topic):
        publisher.listener = subscriber.take
    else:
        subscriber.subscribe()


def _connect_teleop(fkm: Fkm, teleop: Teleop) -> None:
    """Connect as `_connect`; the orientation comes with its protection level."""
    topic = 'orientation'
    if fkm.resolve_topic_name(topic) == teleop.resolve_topic_name(topic):
        fkm.follower = teleop.take
    else:
        teleop.subscribe()


def main(args: list[str] | None = None) -> int:
    """Run the nodes as one process."""
    return runner.run('master', compose, args, OWNED)
