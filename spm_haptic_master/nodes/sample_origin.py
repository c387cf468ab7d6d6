# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where `fkm` has its samples from: one driver, of its mechanism and calibration, and when."""

from __future__ import annotations

import time

from rclpy.node import Node
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.nodes.driver_watch import DriverWatch, host
from spm_haptic_master.ros.cdr import SECOND
from spm_haptic_master.ros.diagnostic_status import (
    CALIBRATION_KEY,
    CHECKSUM_KEY,
    RIVALS_PERIOD,
    UNNAMED,
)
from spm_haptic_master.ros.duplicate_publishers import Rivals
from spm_haptic_master.ros.overload import more_than, TOO_BUSY

# Reason of the silence and its cure where a driver differs, by the key of its entry on
# /diagnostics.
DIFFERENCES = {
    CHECKSUM_KEY: ('another mechanism in the driver',
                   'give geometry.* and working_mode for all nodes, /**'),
    CALIBRATION_KEY: ('another calibration in the driver',
                      'give fkm the calibration file of the driver')}


class SampleOrigin:
    """
    Finds why no sample can be taken, whatever its angles are.

    Parameters
    ----------
    node : Node
        Node that takes the samples and publishes the orientation.
    mechanism, calibration : str
        Checksum of its mechanism, and name of its calibration, empty without one.

    """

    def __init__(self, node: Node, mechanism: str, calibration: str) -> None:
        self._node = node
        # Where the samples come from the topic: what has to be the same in their driver.
        self._shared = {CHECKSUM_KEY: mechanism, CALIBRATION_KEY: calibration or UNNAMED}
        self._rivals = Rivals(node, 'orientation', 'measured_js')
        self._watch: DriverWatch | None = None
        self._hosts = {host()}
        self._obstacle: tuple[str, str] | None = None
        self._find_at = 0.0

    def watch(self) -> DriverWatch:
        """Expect the samples on the topic; return the watch on its drivers."""
        self._hosts = set()
        self._watch = DriverWatch(self._node, self._shared)
        return self._watch

    def obstacle(self) -> tuple[str, str] | None:
        """
        Return reason and detail of what forbids any orientation; None if nothing does.

        More than one source of samples or orientations, another mechanism or calibration in the
        driver; looked for every `RIVALS_PERIOD`.
        """
        now = time.monotonic()
        if now >= self._find_at:
            self._find_at = now + RIVALS_PERIOD
            self._obstacle = self._found()
        return self._obstacle

    def _found(self) -> tuple[str, str] | None:
        rivals = self._rivals.found()
        if rivals is not None:
            return rivals, 'expected one'
        if self._watch is None:
            return None
        self._hosts = self._watch.hosts()
        difference = self._watch.difference()
        if difference is None:
            return None
        reason, cure = DIFFERENCES[difference.key]
        return reason, (f'{difference.driver} has {difference.found}, expected '
                        f'{difference.expected}: {cure}')

    def rejection(self, age: int, max_age: int, is_simulated: bool) -> RejectedError:
        """
        Return why a sample is rejected for its age.

        Parameters
        ----------
        age, max_age : int
            Age of the sample, negative from the future, and its limit, ns.
        is_simulated : bool
            Whether the clock is the topic /clock.

        """
        if age > 0 and self._hosts == {host()} and not is_simulated:
            return RejectedError(TOO_BUSY, f'a sample is {more_than(age / SECOND)} old, '
                                 f'limit {max_age / SECOND:g} s')
        return RejectedError(
            'stale sample' if age > 0 else 'sample from the future',
            f'{age / SECOND:.6f} s old, limit {max_age / SECOND:g} s'
            + ('; are the clocks of the two hosts synchronized?'
               if self._hosts - {host()} else ''))
