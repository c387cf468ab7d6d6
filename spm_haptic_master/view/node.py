# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that shows devices in a browser."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import redirect_stdout, suppress
import errno
import gc
from io import StringIO
import logging
import os
import socket
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.task import Future
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.ros import node_log, runner
from spm_haptic_master.ros.diagnostic_status import STEADY
from spm_haptic_master.ros.parameters import ParameterNode, Parameters, VIEW_SETTINGS
from spm_haptic_master.standard_streams import print_within, STANDARD_OUTPUT
from spm_haptic_master.timing import Periodic
from spm_haptic_master.view.access import guarded
from spm_haptic_master.view.arm import Arm
from spm_haptic_master.view.liveness import Banner, Light
from spm_haptic_master.view.page import Page
from spm_haptic_master.view.scene import ARM_DISTANCE
from viser import ViserServer

# Period in which what is due is drawn (s), and in which devices are looked for.
TICK_PERIOD, FIND_PERIOD = 0.05, 0.5
# Period in which what is no longer used is given back (s): left to itself, Python does so after
# twenty minutes and more.
COLLECT_PERIOD = 30.0
# Period of the news that this program is alive, and least time between two refusals in the
# log (s).
NEWS_PERIOD, REFUSAL_PERIOD = 1.0, 1.0
# By how much the priority of its process is below that of its parent: the device goes first.
NICENESS = 10
# Type and name of the topic that a device has.
TOPIC, TOPIC_TYPE = 'joint_states', 'sensor_msgs/msg/JointState'
# Topic of fkm, by which a device differs from any other robot.
STATE_TOPIC = 'state'
# Most devices in one picture.
LARGEST_NUMBER = 8
# What the page shows before the first device.
NO_DEVICE = Banner(Light.GREY, 'no device found: is master running?', False)
# Last port of TCP.
LAST_PORT = 65535
# Time for the first line (s).
PRINT_TIMEOUT = 1.0
# Light from everywhere (unit 1).
AMBIENT = 0.8
# Where the camera is from what it looks at in each view, for one device; that, for the first
# device (units of the scene); and by how much of it the camera backs off for each further device
# (unit 1).
CAMERAS = {'front': (1.15, -3.1, 1.85), 'side': (3.9, -0.01, 0.4), 'top': (0.0, -0.01, 4.1)}
LOOK_AT, BACK_OFF = (0.0, 0.0, 0.88), 0.75
# Field of view, from top to bottom (rad).
VIEW_ANGLE = 0.75


class View(ParameterNode):
    """
    Serves a page with every device that it finds; in a namespace, with that of the namespace.

    Parameters
    ----------
    done : Future
        Completed when the process that it goes with has ended.

    Raises
    ------
    InputError
        The address cannot be used.

    """

    def __init__(self, parameters: Parameters, done: Future) -> None:
        super().__init__('view', parameters)
        self._done = done
        values = self.declare(VIEW_SETTINGS)
        self._process: int = values['view.process']
        self._end_with_process()
        self._arms: dict[str, Arm] = {}
        # Its messages are taken when they are drawn: at 1 kHz most of them never are.
        self._taker = rclpy.create_node('view_samples', namespace=self.get_namespace(),
                                        start_parameter_services=False, enable_rosout=False)
        self._refusals, self._news = Periodic(REFUSAL_PERIOD), Periodic(NEWS_PERIOD)
        self._server = _server(values['view.host'], values['view.port'], values['view.hosts'],
                               self._report_refusal)
        self._page = Page(self._server, views(1))
        self._page.show('', NO_DEVICE)
        host = self._server.get_host()
        shown = {'0.0.0.0': '127.0.0.1', '::': '::1'}.get(host, host)
        if ':' in shown:
            shown = f'[{shown}]'
        self.url = f'http://{shown}:{self._server.get_port()}'
        if not done.done():
            print_within(STANDARD_OUTPUT, f'view: {self.url}', PRINT_TIMEOUT)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self._find()
        self.create_timer(TICK_PERIOD, self._tick, clock=STEADY)
        self.create_timer(FIND_PERIOD, self._find, clock=STEADY)
        # What is there from the start stays: to look at the rest takes a few milliseconds.
        gc.freeze()
        self.create_timer(COLLECT_PERIOD, _collect, clock=STEADY)

    def destroy_node(self) -> None:
        """End the server and destroy the node."""
        with redirect_stdout(StringIO()):
            self._server.stop()
        self._taker.destroy_node()
        super().destroy_node()

    def _find(self) -> None:
        """Look for devices, their calibrations, and the process that this one goes with."""
        self._end_with_process()
        own = self.get_namespace()
        for namespace in [own] if own != '/' else self._namespaces():
            if namespace not in self._arms and len(self._arms) < LARGEST_NUMBER:
                if not self._arms:
                    self._page.remove('')
                self._arms[namespace] = Arm(self, self._taker, self._server, self._page,
                                            namespace, len(self._arms))
                self._page.views = views(len(self._arms))
                aim(self._server, len(self._arms))
        for arm in self._arms.values():
            arm.check_calibration()

    def _end_with_process(self) -> None:
        if self._process and not _is_running(self._process) and not self._done.done():
            self._done.set_result(None)

    def _namespaces(self) -> list[str]:
        """Return the namespaces with a device that runs or that is being calibrated."""
        topics = dict(self.get_topic_names_and_types())
        found = set()
        for topic, kinds in topics.items():
            before, _, name = topic.rpartition('/')
            if name == TOPIC and TOPIC_TYPE in kinds and f'{before}/{STATE_TOPIC}' in topics:
                found.add(before or '/')
            if topic.endswith(f'/{COVERAGE_TOPIC}') and self.count_publishers(topic):
                found.add(topic.removesuffix(f'/{COVERAGE_TOPIC}') or '/')
        return sorted(found)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for entry in message.status:
            for arm in self._arms.values():
                arm.on_diagnostics(entry)

    def _tick(self) -> None:
        now = time.monotonic()
        for arm in self._arms.values():
            arm.tick(now)
        if self._news.is_due(now):
            self._page.refresh()

    def _report_refusal(self, reason: str) -> None:
        """Log a request that is refused, in a thread of the server, and not each of many."""
        if self._refusals.is_due(time.monotonic()):
            node_log.warning(self, f'a request is refused: {reason}')


def _collect() -> None:
    """Give back what is no longer used: without an argument, which rclpy would have for it."""
    gc.collect()


def _server(host: str, port: int, hosts: str = '',
            report: Callable[[str], None] = lambda _: None) -> ViserServer:
    """
    Return the server of the page; InputError where its address cannot be used.

    Parameters
    ----------
    host, port
        Address and first port to listen on.
    hosts, report
        As of `guarded`.

    """
    # Its log is of connections, to standard error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    port = _free_port(host, port)
    # It prints its address in a frame; the first line of this program has it.
    with redirect_stdout(StringIO()), guarded(host, hosts, report):
        server = ViserServer(host=host, port=port, label='haptic master', verbose=False)
    server.gui.configure_theme(control_width='large', show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction('+z')
    # Shadows take most of the time where no GPU draws them.
    server.scene.configure_default_lights(cast_shadow=False)
    # So do reflections of surroundings that are not there.
    server.scene.configure_environment_map(hdri=None)
    server.scene.add_light_ambient('/ambient', intensity=AMBIENT)
    aim(server, 1)
    server.initial_camera.fov = VIEW_ANGLE
    return server


def _free_port(host: str, first: int) -> int:
    """
    Return the first free port of an address; InputError where there is none, or no such address.

    viser would try one port after the other, for ever or beyond the last.
    """
    try:
        addresses = {(family, address) for family, *_, address in socket.getaddrinfo(
            host, None, type=socket.SOCK_STREAM)}
        for port in range(first, LAST_PORT + 1):
            # An address has its port in the second place, and of IPv6 a scope.
            if all(_is_free(family, (address[0], port, *address[2:]))
                   for family, address in addresses):
                return port
    except OSError as error:
        raise InputError(f"parameter 'view.host' is {host!r}; expected an address of this host "
                         f'({error.strerror})') from error
    raise InputError(f"parameter 'view.port' is {first}; expected a port that is free, or has a "
                     'free one after it')


def _is_free(family: int, address: tuple[Any, ...]) -> bool:
    """Return whether an address with its port is free; OSError where no port of it can be."""
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        # As the server has it: a connection that has just ended does not keep the port.
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind(address)
            trial.listen()
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return False
    return True


def views(arms: int) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return where the camera is, and what it looks at, for views of so many devices in a row."""
    x, y, z = LOOK_AT
    x += 0.5 * ARM_DISTANCE * (arms - 1)
    back = 1.0 + BACK_OFF * (arms - 1)
    return {name: ((x + back * dx, y + back * dy, z + back * dz), (x, y, z))
            for name, (dx, dy, dz) in CAMERAS.items()}


def aim(server: ViserServer, arms: int) -> None:
    """Have the first picture of a page show so many devices in a row."""
    place, target = views(arms)['front']
    server.initial_camera.look_at, server.initial_camera.position = target, place


def _is_running(process: int) -> bool:
    with suppress(PermissionError):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
    return True


def main(args: list[str] | None = None) -> int:
    """Run the node as a process, with less priority than the one that starts it."""
    os.nice(NICENESS)
    return runner.run('view', lambda done, add: add(View, done), args)
