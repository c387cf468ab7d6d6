# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A client of the force feedback of a running master, by its topics."""

import time

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from harness import status
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.force import FORCE_STATES, ForceCondition
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String
from std_srvs.srv import Trigger

# Time that a busy machine may need (s).
PATIENCE = 60.0
# Parameters of a master for it: on a busy machine the client is not to be late.
FORCE = {
    'force.enabled': True,
    'force.without_drives': True,
    'crtk_rate': 0.0,
    'force.wrench_timeout': 0.2,
    'force.engaged_by': 'operating_state',
    'force.protection_limit_deg': 5.0,
    'force.damping': 0.0,
    'force.noise_limit': 100.0,
}
# So often it is tried, because a pause of the machine is a fault of its own.
ATTEMPTS = 20
TORQUE = (0.05, -0.1, 0.1)


class Client:
    """
    A client of one arm: a wrench at 200 Hz with an empty header, as the client of CRTK sends it.

    Attributes
    ----------
    torque : tuple of three float or None
        Torque of its wrenches, N m; None: it sends none.
    sent : int
        Time of the latest wrench, ns.
    changed : list of int
        Times of the wrenches that differ from the one before, ns.

    """

    def __init__(self, observer, arm, topic='servo_cf', qos=10):
        self.observer = observer
        node = observer.node
        self.states = observer.collect(String, f'{arm}/force_state', STATE)
        self.felt = observer.collect(WrenchStamped, f'{arm}/spatial/measured_cf')
        self.joints = observer.collect(JointState, f'{arm}/crtk/measured_js')
        self.health = observer.collect(DiagnosticArray, '/diagnostics')
        self.name = f'{arm}/fkm: force'.lstrip('/')
        self.clients = {
            name: node.create_client(Trigger, f'{arm}/{name}')
            for name in ('enable', 'fkm/acknowledge')
        }
        self.publisher = node.create_publisher(WrenchStamped, f'{arm}/{topic}', qos)
        self.torque = None
        self.sent = 0
        self.changed = []
        self._latest = None
        node.create_timer(0.005, self._send)

    def _send(self):
        if self.torque is not None:
            message = WrenchStamped()
            t = message.wrench.torque
            t.x, t.y, t.z = self.torque
            self.sent = time.time_ns()
            self.publisher.publish(message)
            if self.torque != self._latest:
                self._latest = self.torque
                self.changed.append(self.sent)

    @property
    def state(self):
        return FORCE_STATES.get(self.states[-1][1].data) if self.states else None

    def call(self, name):
        future = self.clients[name].call_async(Trigger.Request())
        assert self.observer.spin_until(future.done, PATIENCE)
        return future.result()

    def awaits(self, condition, seconds=PATIENCE):
        return self.observer.spin_until(
            lambda: self.state is not None and self.state.condition is condition, seconds
        )

    def engage(self):
        """Engage, again where a pause of a busy machine ended it."""
        assert self.observer.spin_until(
            lambda: self.states and all(each.service_is_ready() for each in self.clients.values()),
            PATIENCE,
        )
        self.torque = (0.0, 0.0, 0.0)
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if self.state.condition is ForceCondition.FAULT:
                self.call('fkm/acknowledge')
            self.call('enable')
            if self.awaits(ForceCondition.ENGAGED, 2.0):
                return
        pytest.fail(f'{self.state}, {status(self.health, self.name)}')

    def feels(self, torque, beside=lambda: True, felt=None):
        """
        Return whether a torque is rendered, in the base frame, and a condition holds beside it.

        It engages again after a pause of the machine.
        """

        def is_felt():
            latest = self.felt[-1][1].wrench.torque
            return (
                np.abs(
                    np.subtract(torque if felt is None else felt, (latest.x, latest.y, latest.z))
                ).max()
                < 0.01
            )

        for _ in range(ATTEMPTS):
            self.engage()
            self.torque = torque
            del self.felt[:]
            if self.observer.spin_until(
                lambda: (
                    self.state.condition is not ForceCondition.ENGAGED
                    or (self.felt and is_felt() and beside())
                ),
                6.0,
            ) and (self.state.condition is ForceCondition.ENGAGED):
                return True
        return False

    def entry(self):
        """Return message and values of the entry on /diagnostics."""
        found = status(self.health, self.name)
        return (
            ('', {})
            if found is None
            else (found.message, {value.key: value.value for value in found.values})
        )

    def figure(self, key):
        """Return a number of that entry; 0 where it has none."""
        text = self.entry()[1].get(key, 'none')
        return 0.0 if text == 'none' else float(text)
