# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a calibration by motion shows of itself, as a topic: `view` draws it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from spm_haptic_master.parameters.resolver import Parameters

# Takes an instruction and the shares of what it needs, 0 .. 1, by name.
Publish = Callable[[str, Mapping[str, float]], None]
# Name of the node.
NODE = 'calibrate'


@contextmanager
def published(remaps: Sequence[str]) -> Iterator[Publish]:
    """
    Publish a calibration's state on `calibration/coverage` of a namespace.

    Where there is no rclpy, nothing is published: the terminal shows the same.

    Parameters
    ----------
    remaps : sequence of str
        ROS remappings; __ns gives the namespace.

    Yields
    ------
    callable
        Publishes a state.

    """
    try:
        from spm_haptic_master.nodes.guidance_publisher import GuidancePublisher
    except ImportError:
        yield _nowhere
        return
    publisher = GuidancePublisher(Parameters(remaps=remaps).full_name(NODE))
    try:
        yield publisher.publish
    finally:
        publisher.close()


def _nowhere(text: str, shares: Mapping[str, float]) -> None:
    """Publish nothing."""
