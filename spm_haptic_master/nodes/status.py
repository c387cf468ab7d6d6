# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One screen of the running device: what is wrong, and its remedy.

Exit code 0 where all is well; 1 where something warns, fails, or does not answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
import os
import sys

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.parameter import parameter_value_to_python
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.nodes.status_screen import Device, Entry, screen
from spm_haptic_master.parameters.arguments import OneLineParser, positive
from spm_haptic_master.ros.client import Client, run
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String

# Time for which entries are collected (s): each node publishes its own every second.
SECONDS = 2.5
# State topics, latched, whose text an entry does not have.
STATES = ('source', 'operating_state_text')
# Limits that are shown, by node.
LIMITS = {
    'fkm': (
        'alert_limit_deg',
        'unchecked_limit',
        'max_age',
        'rate',
    ),
    'teleop': (
        'teleop.speed_limit',
        'teleop.protection_limit_deg',
        'teleop.jump_limit_deg',
    ),
}
# Entries whose nodes have limits, by node.
OF_NODE = {
    'fkm': 'fkm: orientation',
    'teleop': 'teleop: teleop',
}


class Collector(Client):
    """
    Collects what the devices of this DDS domain, or of one namespace, report.

    Attributes
    ----------
    PATIENCE : float
        Time to wait for a node's answer, s.

    """

    # The nodes answer at once, or are gone.
    PATIENCE = 1.0

    def __init__(self) -> None:
        super().__init__('status')
        # Only this namespace is shown, if one is given (-r __ns:=/left).
        self._namespace = self.node.get_namespace().strip('/')
        self._devices: dict[str, Device] = {}
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 100)

    def devices(self, seconds: float) -> list[Device]:
        """
        Return the devices that report.

        Parameters
        ----------
        seconds : float
            Time for which entries are collected.

        Returns
        -------
        list of Device
            Sorted by namespace, with the limits of their nodes.

        Raises
        ------
        InputError
            Nothing has reported.

        """
        self.wait(lambda: False, seconds)
        if not self._devices:
            where = 'this ROS_DOMAIN_ID'
            if self._namespace:
                where = f'/{self._namespace}'
            domain = os.environ.get('ROS_DOMAIN_ID') or '0'
            raise InputError(
                f'nothing reports in {where} (ROS_DOMAIN_ID {domain}): is master running, on this '
                'host or with ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET?'
            )
        found = [self._devices[name] for name in sorted(self._devices)]
        for device in found:
            self._ask_limits(device)
        return found

    def _take(self, message: DiagnosticArray) -> None:
        """Store the entries of nodes of this package, by their namespace."""
        for status in message.status:
            node, _, aspect = status.name.partition(': ')
            namespace, _, name = node.rpartition('/')
            is_of_other = self._namespace and namespace != self._namespace
            if not aspect or is_of_other:
                continue
            device = self._devices.get(namespace)
            if device is None:
                device = Device(namespace)
                self._devices[namespace] = device
                self._watch_states(device)
            device.entries[f'{name}: {aspect}'] = Entry(
                level=status.level,
                message=status.message,
                values={entry.key: entry.value for entry in status.values},
            )

    def _watch_states(self, device: Device) -> None:
        """Subscribe to the latched texts of a device."""
        prefix = f'/{device.namespace}'.rstrip('/')
        for topic in STATES:
            take = partial(self._take_state, device, topic)
            self.node.create_subscription(String, f'{prefix}/{topic}', take, STATE)

    def _take_state(
        self,
        device: Device,
        topic: str,
        message: String,
    ) -> None:
        """Store the text of a state topic."""
        device.states[topic] = message.data

    def _ask_limits(self, device: Device) -> None:
        """
        Ask the nodes of a device for the limits that are shown.

        A node without an entry on /diagnostics is not asked.
        """
        prefix = f'/{device.namespace}'.rstrip('/')
        for node, names in LIMITS.items():
            if OF_NODE[node] in device.entries:
                device.limits[node] = self._values(f'{prefix}/{node}', names)

    def _values(self, node: str, names: Sequence[str]) -> str | None:
        """
        Return parameters of a node as words; None where it does not answer.

        Parameters
        ----------
        node : str
            Fully qualified name of the node.
        names : sequence of str
            Names of the parameters.

        Returns
        -------
        str or None
            Names and values of those that are numbers.

        """
        try:
            answer = self.ask(f'{node}/get_parameters', GetParameters, names=list(names))
        except InputError:
            return None
        values = map(parameter_value_to_python, answer.values)
        words = []
        for name, value in zip(names, values, strict=False):
            if isinstance(value, (int, float)):
                words.append(f'{name} {value:g}')
        return ', '.join(words)


def main(args: list[str] | None = None) -> int:
    """Print the screen; return 0 where all is well."""
    words = sys.argv if args is None else args
    own = words[1:]
    ros_arguments: list[str] = []
    if '--ros-args' in own:
        begin = own.index('--ros-args')
        ros_arguments = own[begin:]
        own = own[:begin]

    def program() -> int:
        parser = OneLineParser('status', description=__doc__)
        parser.add_argument(
            '--seconds',
            type=positive,
            default=SECONDS,
            help=f'time for which reports are collected ({SECONDS:g})',
        )
        seconds = parser.parse_args(own).seconds
        devices = Collector().devices(seconds)
        for device in devices:
            if len(devices) > 1:
                print(f'/{device.namespace}')
            print('\n'.join(screen(device)))
        cores = os.cpu_count() or 1
        load = os.getloadavg()[0]
        print(f'      {"load":<15} {load:.1f} of {cores} cores of this host')
        if all(device.is_well() for device in devices):
            return 0
        return 1

    return run('status', program, ros_arguments)
