# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion of insertion and gripper on the simulated bus."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sin

from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.encoders.single_axis import SingleAxis
from spm_haptic_master.parameters.axes import INSERTION

# Time of one stroke forth and back of the slide and of the gripper (s), and the share of the range
# that it has (unit 1).
INSERTION_STROKE = 10.0
GRIPPER_STROKE = 4.0
SHARE = 0.8


@dataclass(frozen=True, slots=True)
class SimulatedAxis:
    """
    One axis that moves forth and back about the middle of its range.

    Attributes
    ----------
    layout : EncoderLayout
        Frame of its encoder.
    node_id : int or None
        CANopen node id; None for an encoder that only answers SYNC.
    middle, amplitude : float
        Middle and amplitude of its motion, m or rad.
    stroke : float
        Time of one stroke forth and back, s.
    scale : float
        Position over the layout's angle: m/rad for a slide, 1 for a gripper.

    """

    layout: EncoderLayout
    node_id: int | None
    middle: float
    amplitude: float
    stroke: float
    scale: float

    def position(self, t: float) -> float:
        """Return the position at `t`, s, in m or rad."""
        angle = 2.0 * pi * t / self.stroke
        return self.middle + self.amplitude * sin(angle)

    def angle(self, t: float) -> float:
        """Return the angle of its layout at `t`, s, rad."""
        return self.position(t) / self.scale


def simulated_axis(axis: SingleAxis) -> SimulatedAxis:
    """Return the simulated encoder of an axis."""
    limits = axis.limits
    node_id = None
    if axis.node is not None:
        node_id = axis.node.node_id
    stroke = GRIPPER_STROKE
    if axis.name == INSERTION:
        stroke = INSERTION_STROKE
    return SimulatedAxis(
        layout=axis.layout,
        node_id=node_id,
        middle=0.5 * (limits.least + limits.greatest),
        amplitude=0.5 * SHARE * (limits.greatest - limits.least),
        stroke=stroke,
        scale=axis.scale,
    )
