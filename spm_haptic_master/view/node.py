# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that shows devices in a browser."""

from __future__ import annotations

from contextlib import redirect_stdout
import gc
from io import StringIO
import os
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.task import Future
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.ros import node_log, runner
from spm_haptic_master.ros.diagnostic_status import STEADY
from spm_haptic_master.ros.parameters import ParameterNode, Parameters, VIEW_SETTINGS
from spm_haptic_master.standard_streams import print_within, STANDARD_OUTPUT
from spm_haptic_master.timing import Periodic
from spm_haptic_master.view.arm import Arm
from spm_haptic_master.view.page import Page, place_of
from spm_haptic_master.view.server import in_url, serve

# Periods of drawing and of looking for devices (s).
TICK_PERIOD = 0.05
FIND_PERIOD = 0.5
# Period of the garbage collection (s): Python's own comes after twenty minutes and more.
COLLECT_PERIOD = 30.0
# Period of the news, and shortest time between two refusals in the log (s).
NEWS_PERIOD = 0.25
REFUSAL_PERIOD = 1.0
# Niceness of the process above that of its parent: the device has priority.
NICENESS = 10
# Topic of fkm, by which a device is found; and name and type of those of which one comes with it,
# which distinguishes a device from other robots: diagnostics may not run.
STATE_TOPIC = 'state'
OTHER_TOPICS = {
    'joint_states': 'sensor_msgs/msg/JointState',
    'orientation': 'geometry_msgs/msg/QuaternionStamped',
}
# Largest number of devices in one picture.
LARGEST_NUMBER = 8
# Time for the first line (s).
PRINT_TIMEOUT = 1.0


class View(ParameterNode):
    """
    Serves a page with every device that it finds; in a namespace, with that of the namespace.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process.
    done : Future
        Is completed when the process `view.process` has ended.

    Raises
    ------
    InputError
        The address cannot be used.

    Attributes
    ----------
    url : str
        Address of the page.

    """

    def __init__(self, parameters: Parameters, done: Future) -> None:
        super().__init__('view', parameters)
        self._done = done
        values = self.declare(VIEW_SETTINGS)
        self._process: int = values['view.process']
        self._arms: dict[str, Arm] = {}
        # Only messages that are drawn are taken: at 1 kHz these are few.
        self._taker = rclpy.create_node(
            'view_samples',
            namespace=self.get_namespace(),
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._refusals = Periodic(REFUSAL_PERIOD)
        self._news = Periodic(NEWS_PERIOD)
        self._server = serve(
            values['view.host'],
            values['view.port'],
            values['view.hosts'],
            self._report_refusal,
        )
        self._page = Page(self._server)
        host = self._server.get_host()
        shown = in_url({'0.0.0.0': '127.0.0.1', '::': '::1'}.get(host, host))
        self.url = f'http://{shown}:{self._server.get_port()}'
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._find()
        print_within(STANDARD_OUTPUT, f'view: {self.url}', PRINT_TIMEOUT)
        self.create_timer(TICK_PERIOD, self._tick, clock=STEADY)
        self.create_timer(FIND_PERIOD, self._find, clock=STEADY)
        # Objects of the start are never collected: the rest takes a few milliseconds.
        gc.freeze()
        # rclpy would pass an argument to `gc.collect`, which accepts one.
        self.create_timer(COLLECT_PERIOD, lambda: gc.collect(), clock=STEADY)

    def destroy_node(self) -> None:
        """End the server and destroy the node."""
        with redirect_stdout(StringIO()):
            self._server.stop()
        self._taker.destroy_node()
        super().destroy_node()

    def _find(self) -> None:
        """Poll for devices, and for the process that ends this one."""
        if self._process and not Path(f'/proc/{self._process}').exists():
            self._done.set_result(None)
        before = set(self._arms)
        self._drop()
        own = self.get_namespace()
        for namespace in [own] if own != '/' else self._namespaces():
            if namespace not in self._arms and len(self._arms) < LARGEST_NUMBER:
                self._arms[namespace] = Arm(
                    node=self,
                    taker=self._taker,
                    page=self._page,
                    namespace=namespace,
                )
        if set(self._arms) != before:
            self._arrange()

    def _drop(self) -> None:
        """Drop devices whose programs ended a minute ago, if the program of another one runs."""
        now = time.monotonic()
        there = {namespace for namespace, arm in self._arms.items() if arm.is_there(now)}
        if not there:
            return
        for namespace in set(self._arms) - there:
            self._arms.pop(namespace).close()

    def _arrange(self) -> None:
        """Let the devices stand by their names: the left one on the left, else by the alphabet."""
        for rank, namespace in enumerate(sorted(self._arms, key=place_of)):
            self._arms[namespace].stand(rank)
        self._page.aim(len(self._arms))
        self._page.refresh()

    def _namespaces(self) -> list[str]:
        """
        Return the namespaces with a device that runs or that is being calibrated.

        A device that runs has a publisher of `state`, and `orientation` or `joint_states`.

        Returns
        -------
        list of str
            Namespaces, sorted, '/' or '/NAME'.

        """
        topics = dict(self.get_topic_names_and_types())
        found = set()
        for topic, kinds in topics.items():
            before, _, name = topic.rpartition('/')
            if OTHER_TOPICS.get(name) in kinds:
                # This node alone may still subscribe to them.
                if self.count_publishers(f'{before}/{STATE_TOPIC}'):
                    found.add(before or '/')
            if topic.endswith(f'/{COVERAGE_TOPIC}') and self.count_publishers(topic):
                found.add(topic.removesuffix(f'/{COVERAGE_TOPIC}') or '/')
        return sorted(found)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """Pass each entry to the devices: one of them keeps it."""
        for entry in message.status:
            for arm in self._arms.values():
                arm.on_diagnostics(entry)

    def _tick(self) -> None:
        """Draw what is due, and send the news."""
        now = time.monotonic()
        for arm in self._arms.values():
            arm.tick(now)
        if self._news.is_due(now):
            self._page.refresh()

    def _report_refusal(self, reason: str) -> None:
        """Log a refused request, at most one a second; a thread of the server calls it."""
        if self._refusals.is_due(time.monotonic()):
            node_log.warning(self, f'a request is refused: {reason}')


def main(args: list[str] | None = None) -> int:
    """
    Run the node as a process, with less priority than the one that starts it.

    Parameters
    ----------
    args : list of str, optional
        The command line with the name, by default that of this process.

    Returns
    -------
    int
        Exit code.

    """
    os.nice(NICENESS)
    return runner.run('view', lambda done, add: add(View, done), args)
