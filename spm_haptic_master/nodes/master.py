# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Driver, forward model, diagnostics and teleop in one process, with a line a second."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.task import Future
from spm_haptic_master.drives.shared_bus import check_shared_bus
from spm_haptic_master.nodes.console import Console
from spm_haptic_master.nodes.diagnostics import Diagnostics
from spm_haptic_master.nodes.encoder_driver import EncoderDriver
from spm_haptic_master.nodes.fkm import Fkm
from spm_haptic_master.nodes.teleop import Teleop
from spm_haptic_master.parameters.nodes import MASTER_SETTINGS
from spm_haptic_master.parameters.resolver import check_agreement
from spm_haptic_master.ros import runner

# What a second master must not publish: it would silence the first.
OWNED = {
    'fkm': 'orientation',
    'encoder_driver': 'measured_js',
}


def compose(done: Future, add: runner.AddNode) -> None:
    """
    Make the nodes of `master` and connect those that share a topic by plain calls.

    Parameters
    ----------
    done : Future
        Ends the process: the driver completes it when its source ends or fails.
    add : callable
        Makes a node of a class, as of `runner.run`.

    Raises
    ------
    SettingError
        Two nodes have different values of a setting that they share, or the drives of the force
        feedback cannot share the bus of the encoders.

    """
    fkm = add(Fkm)
    runs_teleop = fkm.declare(MASTER_SETTINGS)['teleop.run']
    # In the order in which they get an orientation: the command of a slave goes out first.
    followers: list[Teleop | Diagnostics] = []
    if runs_teleop:
        followers.append(add(Teleop))
    diagnostics = add(Diagnostics)
    followers.append(diagnostics)
    # The driver is made last, because it is destroyed first.
    driver = add(EncoderDriver, done)
    nodes = (driver, fkm, *followers)
    check_agreement({node.get_name(): node.values for node in nodes})
    if fkm.force_state is not None and driver.source_name == 'can':
        check_shared_bus(fkm.values, driver.values)
    if _is_one_topic('measured_js', driver, fkm):
        driver.listener = fkm.take
    fkm.driver_overload = lambda: driver.overload.words
    for follower in followers:
        if _is_one_topic('orientation', fkm, follower):
            fkm.followers.append(follower.take)
    Console(driver, fkm, diagnostics).start()


def _is_one_topic(
    topic: str,
    publisher: Node,
    subscriber: Fkm | Diagnostics | Teleop,
) -> bool:
    """Return whether a plain call replaces a topic; subscribe where one of the two remaps it."""
    published = publisher.resolve_topic_name(topic)
    if published == subscriber.resolve_topic_name(topic):
        return True
    subscriber.subscribe()
    return False


def main(args: list[str] | None = None) -> int:
    """Run the nodes as one process."""
    return runner.run('master', compose, args, OWNED)
