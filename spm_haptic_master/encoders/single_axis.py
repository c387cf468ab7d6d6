# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
An encoder that no other one checks: the insertion or the gripper.

Its readings are no part of a set, and no set waits for them. Range, speed, age and the node's own
words are all that can be known of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, radians
from typing import NamedTuple

import can
from spm_haptic_master.encoders.canopen_nodes import Node
from spm_haptic_master.encoders.encoder_layout import Encoder, EncoderLayout, TURN
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.axes import AXES, GRIPPER, INSERTION
from spm_haptic_master.parameters.setting import Values

# Periods without a reading after which it is missing.
MISSING_PERIODS = 3.0
# Time of good readings after a fast one until the next is taken: so many periods, and a time (s).
# It is longer than whoever follows the axis waits for a reading: a jump that stays disengages.
SETTLE_PERIODS = 3.0
SETTLE_TIME = 0.03
# Share of the range beyond its ends that is still a reading (unit 1).
BEYOND_RANGE = 0.02


class AxisReading(NamedTuple):
    """
    Position of one axis.

    Attributes
    ----------
    name : str
        Name of the axis.
    stamp : int
        Time of sampling, ns since the Unix epoch.
    position : float
        Position, m or rad.

    """

    name: str
    stamp: int
    position: float


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """
    What a reading may be.

    Attributes
    ----------
    least, greatest : float
        Ends of the range, m or rad.
    speed : float
        Largest speed, m/s or rad/s; infinite without a limit.

    """

    least: float
    greatest: float
    speed: float

    @property
    def bounds(self) -> tuple[float, float]:
        """Return least and greatest position of a reading: the range and a margin, m or rad."""
        margin = BEYOND_RANGE * (self.greatest - self.least)
        return self.least - margin, self.greatest + margin


class SingleAxis:
    """
    Readings of one axis from its frames.

    Parameters
    ----------
    layout
        Its frame; the name of its joint is that of the axis.
    scale
        Position over the layout's angle: 1 for a gripper, m/rad for a slide.
    limits
        Range and speed of good readings.
    period
        Time between two readings, s.
    node
        Its CANopen node, None if it is none.

    """

    def __init__(
        self,
        layout: EncoderLayout,
        scale: float,
        limits: AxisLimits,
        period: float,
        node: Node | None,
    ):
        self.layout = layout
        self.scale = scale
        self.node = node
        self.encoder = Encoder(layout)
        self.limits = limits
        self._period = period
        self._lowest, self._highest = limits.bounds
        # Time, s, and position of the latest frame within the range; of the latest good reading.
        self._previous: tuple[float, float] | None = None
        self.latest: tuple[float, float] | None = None
        # Time until which it is not believed after it was too fast, s; and why it is silent.
        self._settles_at = float('-inf')
        self._reason: str | None = None

    @property
    def name(self) -> str:
        """Return the name of the axis."""
        return self.layout.joint

    def read_counts(self) -> None:
        """Make each reading its counts, from -1/2 to 1/2 turn, whatever they are."""
        self.scale = self.layout.counts_per_turn / TURN
        self.limits = AxisLimits(
            least=-inf,
            greatest=inf,
            speed=inf,
        )
        self._lowest, self._highest = self.limits.bounds

    def take(self, message: can.Message, stamp: float) -> AxisReading | None:
        """
        Take a frame of the axis.

        Parameters
        ----------
        message : can.Message
            Frame with its identifier, stamped in s since the Unix epoch.
        stamp : float
            Time at which it was sampled, s since the Unix epoch.

        Returns
        -------
        AxisReading or None
            Its reading; None if it has none that is good.

        """
        angle, reason = self.encoder.check(message)
        position = angle * self.scale
        if reason is None and self.node is not None:
            reason = self.node.unfit(message.timestamp)
        if reason is None and not self._lowest <= position <= self._highest:
            limits = self.limits
            reason = f'out of range ({position:.4g}; {limits.least:g} to {limits.greatest:g})'
        if reason is None and self._is_too_fast(position, stamp):
            reason = f'faster than {self.limits.speed:g} per second'
        self._reason = reason
        if reason is not None:
            return None
        self.latest = stamp, position
        return AxisReading(
            name=self.layout.joint,
            stamp=round(stamp * 1e9),
            position=position,
        )

    def fault(self, now: float) -> str | None:
        """
        Return why there is no reading at present.

        Parameters
        ----------
        now : float
            Time, s since the Unix epoch.

        Returns
        -------
        str or None
            The reason, with the name of the axis; None if there is a reading.

        """
        if self.latest is None:
            heard = None
        else:
            heard = self.latest[0]
        if heard is not None and abs(now - heard) <= MISSING_PERIODS * self._period:
            return None
        refused = self.encoder.refused
        recent = refused is not None and abs(now - refused[0]) <= MISSING_PERIODS * self._period
        if self._reason and (recent or self._is_heard(now)):
            return f'{self.name}: {self._reason}'
        if self.node:
            trouble = self.node.trouble(now)
        else:
            trouble = None
        return f'{self.name} missing ({trouble or "no frames"})'

    def _is_heard(self, now: float) -> bool:
        """Return whether a good frame came within MISSING_PERIODS of a time, s."""
        heard = self.encoder.heard
        return heard is not None and abs(now - heard) <= MISSING_PERIODS * self._period

    def _is_too_fast(self, position: float, stamp: float) -> bool:
        """Return whether it moves faster than its limit, or has not settled since."""
        before = self._previous
        self._previous = stamp, position
        if before is None:
            return False
        elapsed = stamp - before[0]
        longest_way = self.limits.speed * max(elapsed, self._period)
        if elapsed <= 0.0 or abs(position - before[1]) > longest_way:
            self._settles_at = stamp + SETTLE_PERIODS * self._period + SETTLE_TIME
        return stamp < self._settles_at


def make_axes(values: Values, timeout: float) -> tuple[SingleAxis, ...]:
    """
    Return the axes that have an encoder.

    Parameters
    ----------
    values : Values
        Checked settings.
    timeout : float
        Time without a heartbeat after which that is lost, s.

    Raises
    ------
    SettingError
        Their settings contradict each other.

    """
    return tuple(_axis(name, values, timeout) for name in AXES if values[f'{name}.id'])


def _axis(
    name: str,
    values: Values,
    timeout: float,
) -> SingleAxis:
    """
    Return one axis by its settings, as `make_axes`.

    Angles and counts are related as those of a joint. A slide has no turn of its own: all its
    counts are made one turn, and `insertion.counts_per_metre` gives the scale, m/rad.
    """
    layout = _layout(name, values)
    limits, scale = _limits(name, values, layout.counts_per_turn)
    node_id = int(values[f'{name}.node_id'])
    node = None
    if node_id:
        node = Node(name, node_id, timeout)
    return SingleAxis(
        layout=layout,
        scale=scale,
        limits=limits,
        period=1.0 / values['rate'],
        node=node,
    )


def _layout(name: str, values: Values) -> EncoderLayout:
    """Return how the counts of an axis stand in its frame."""

    def value(setting: str) -> int:
        return int(values[f'{name}.{setting}'])

    if name == GRIPPER:
        turn = values['gripper.counts_per_turn']
    else:
        turn = 1 << _bits(name, values)
    return EncoderLayout(
        joint=name,
        can_id=value('id'),
        extended=values[f'{name}.extended'],
        data_length=value('data_length'),
        byte_offset=value('byte_offset'),
        bit_length=value('bit_length'),
        byte_order=values[f'{name}.byte_order'],
        mask=value('mask'),
        signed=values[f'{name}.signed'],
        counts_per_turn=turn,
        direction=value('direction'),
        zero_count=value('zero_count'),
        counter_byte=0,
        counter_mask=0,
        status_byte=value('status_byte'),
        status_mask=value('status_mask'),
        status_good=value('status_good'),
    )


def _bits(name: str, values: Values) -> int:
    """Return how many bits the counts of an axis have."""
    mask = int(values[f'{name}.mask'])
    return mask.bit_count() or int(values[f'{name}.bit_length'])


def _limits(
    name: str,
    values: Values,
    counts_per_turn: int,
) -> tuple[AxisLimits, float]:
    """
    Return range and speed of an axis, and its scale: m/rad of a slide, 1 of the gripper.

    Parameters
    ----------
    name : str
        The axis, one of AXES.
    values : Values
        Checked settings.
    counts_per_turn : int
        Counts of 2 pi rad.

    Returns
    -------
    tuple of AxisLimits and float
        Limits in m or rad, and the scale.

    Raises
    ------
    SettingError
        The range is empty, or its counts do not fit into the frame.

    """
    if name == INSERTION:
        setting = 'insertion.range'
    else:
        setting = 'gripper.range_deg'
    least, greatest = values[setting]
    if not least < greatest:
        raise SettingError(
            name=setting,
            value=[least, greatest],
            expected='the lesser value first',
        )
    if name == INSERTION:
        scale = counts_per_turn / TURN / values['insertion.counts_per_metre']
        limits = AxisLimits(
            least=least,
            greatest=greatest,
            speed=values['insertion.speed_limit'],
        )
    else:
        scale = 1.0
        limits = AxisLimits(
            least=radians(least),
            greatest=radians(greatest),
            speed=float('inf'),
        )
    if max(abs(limits.least), abs(limits.greatest)) > pi * scale:
        raise SettingError(
            name=setting,
            value=[least, greatest],
            expected=f'what {_bits(name, values)} bits of counts can hold',
        )
    return limits, scale
