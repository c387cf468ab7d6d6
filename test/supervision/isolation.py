# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Symptoms, and a fault isolation that takes them sample by sample."""

from types import SimpleNamespace

from product_limits import product_limits
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.supervision.fault_isolation import FaultIsolation
from spm_haptic_master.supervision.symptom import Symptom

DT = 1e-3
QUIET = (0.0, 0.0, 0.0, 0.0)
# A symptom of sensor 0, of sensor 3, of no sensor, one latched at once, one timed by its monitor.
JUMPED = Symptom('jumped', '0.1 rad', 0)
OTHER = Symptom('too fast', '30 rad/s', 3)
PARITY = Symptom('inconsistent angles', 'parity 8')
DRIFT = Symptom('angles drifted apart', 'parity 7', fault=True)
FROZEN = Symptom('frozen', '15 times', 1, self_timed=True)
STUCK = FROZEN._replace(fault=True)


class Joints:
    """Records which trackers are restarted."""

    period = DT

    def __init__(self):
        self.restarted = []

    def restart_sensors(self, sensors):
        self.restarted.append(list(sensors))


class Isolation(FaultIsolation):
    """The fault isolation with recorded restarts, and one call a sample."""

    def __init__(self, healthy=True, **limits):
        self.joints = Joints()
        super().__init__(product_limits(**limits), self.joints)
        if healthy:
            for _ in range(5):
                self.sample()

    def sample(self, *symptoms, innovations=QUIET, sensitivity=(0.5,) * 4, dt=DT):
        """Return why the sample is withheld, '' if it is not, as the supervisor asks."""
        symptoms = list(symptoms)
        estimate = SimpleNamespace(sensitivity=sensitivity)
        self.update(symptoms, innovations)
        try:
            if self.fault is not None and not self.clear(self.fault, estimate, symptoms, dt):
                self.restart_persistent(symptoms)
                return self.fault.text
            if symptoms:
                self.withhold(symptoms)
            self.settle()
        except RejectedError as rejection:
            return rejection.reason
        self.confirm()
        return ''
