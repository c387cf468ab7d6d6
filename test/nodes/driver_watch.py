# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An encoder driver that produces SYNC on a bus, and all that it publishes."""

from diagnostic_msgs.msg import DiagnosticArray
from harness import Observer, stamp, start_program
import numpy as np
from sensor_msgs.msg import JointState
from spm_haptic_master.parameters.files import simulated_rig

STATUS = 'encoder_driver: encoders'
# Rate of SYNC (Hz).
RATE = 500.0


def bus_parameters(channel):
    return {'can.interface': 'udp_multicast', 'can.channel': channel, 'rate': RATE}


class Watch:
    """A driver as SYNC master, and all that it publishes."""

    def __init__(self, parameters, **environment):
        self.observer = Observer()
        self.samples = self.observer.collect(JointState, 'measured_js')
        self.health = self.observer.collect(DiagnosticArray, '/diagnostics')
        self.driver = start_program('encoder_driver', parameters={
            'source': 'can', 'can.sync': 'produce', **simulated_rig(), **parameters},
            **environment)

    def stamps(self):
        """Return the samples' stamps, s."""
        return np.array([stamp(message) for _, message in self.samples]) * 1e-9

    def changes(self):
        """Return (arrival in s, level, message) of each change on /diagnostics."""
        found = []
        for arrived, array in self.health:
            for entry in array.status:
                if entry.name == STATUS and (not found or found[-1][2] != entry.message):
                    found.append((arrived * 1e-9, entry.level, entry.message))
        return found

    def message(self):
        changes = self.changes()
        return changes[-1][2] if changes else ''

    def close(self):
        code = self.driver.stop()
        self.observer.close()
        return code
