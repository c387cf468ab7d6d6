# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From the slave's torque to the hand: teleop and force feedback in one process."""

from benchmarks.surgeon import Surgeon
from force_client import ATTEMPTS, FORCE, PATIENCE, TORQUE
from geometry_msgs.msg import WrenchStamped
from harness import SIM
import numpy as np
import pytest
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process

# A pause of a busy machine is no silence.
MASTER = {**SIM, 'sim.trajectory': 'fixed', 'sim.pose_deg': [130.0, 50.0, 20.0], 'rate': 500.0,
          'sample_timeout': 2.0, 'max_age': 2.0, 'alert_limit_deg': 5.0, 'crtk_rate': 0.0,
          'teleop.run': True, 'teleop.orientation_timeout': 1.0, 'teleop.slave_timeout': 2.0,
          'teleop.presence_timeout': 2.0, 'teleop.force_scale': 0.5, **FORCE,
          'force.engaged_by': 'teleop'}


def test_the_hand_feels_the_slave_while_it_leads_it(start, observer):
    start('sim_slave')
    start('master', parameters=MASTER)
    states = observer.collect(String, 'force_state', STATE)
    felt = observer.collect(WrenchStamped, 'spatial/measured_cf')
    out = observer.node.create_publisher(WrenchStamped, 'slave/measured_cf', 10)
    acknowledge = observer.node.create_client(Trigger, 'fkm/acknowledge')
    torque = [0.0, 0.0, 0.0]

    def send():
        message = WrenchStamped()
        t = message.wrench.torque
        t.x, t.y, t.z = torque
        out.publish(message)

    observer.node.create_timer(0.005, send)

    def is_felt():
        t = felt[-1][1].wrench.torque if felt else None
        return t is not None and np.abs(np.subtract(
            0.5 * np.array(TORQUE), (t.x, t.y, t.z))).max() < 0.01

    with Surgeon() as surgeon:
        assert surgeon.await_ready(PATIENCE) and observer.spin_until(lambda: states, PATIENCE)
        for _ in range(ATTEMPTS):
            # Again, where a pause of the machine ended it.
            torque[:] = 0.0, 0.0, 0.0
            surgeon.press('clutch', False)
            acknowledge.call_async(Trigger.Request())
            assert surgeon.engage(PATIENCE), surgeon.state
            if not observer.spin_until(lambda: states[-1][1].data == 'engaged', 5.0):
                continue
            torque[:] = TORQUE
            if not observer.spin_until(is_felt, 5.0):
                continue
            surgeon.press('clutch', True)
            if surgeon.await_state('clutched', 5.0) and observer.spin_until(
                    lambda: states[-1][1].data == 'holding', 5.0):
                break
        else:
            pytest.fail(f'{states[-1][1].data}, {surgeon.state}')
        del felt[:]
        assert observer.spin_until(lambda: felt and not any(
            (felt[-1][1].wrench.torque.x, felt[-1][1].wrench.torque.y)), PATIENCE)
        surgeon.press('presence', False)
        assert surgeon.await_state('disengaged', PATIENCE)
        assert observer.spin_until(
            lambda: states[-1][1].data.partition(':')[0] in ('ready', 'fault'), PATIENCE)
