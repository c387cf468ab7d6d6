# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The box in examples/ is felt as it is written there."""

import time

from force_client import FORCE, PATIENCE
from geometry_msgs.msg import WrenchStamped
from harness import ROOT, SIM
import numpy as np
import pytest
from spm_haptic_master.ros.qos import STATE
from std_msgs.msg import String
from std_srvs.srv import Trigger

pytestmark = pytest.mark.process


def test_the_walls_of_the_box_are_felt(start, start_python, observer):
    start(
        'master',
        parameters={
            **SIM,
            'sim.trajectory': 'perturbed',
            'rate': 500.0,
            'max_age': 2.0,
            'alert_limit_deg': 5.0,
            **FORCE,
        },
    )
    box = start_python(str(ROOT / 'examples' / 'box.py'))
    states = observer.collect(String, 'force_state', STATE)
    felt = observer.collect(WrenchStamped, 'spatial/measured_cf')
    clients = [
        observer.node.create_client(Trigger, name) for name in ('enable', 'fkm/acknowledge')
    ]
    assert observer.spin_until(
        lambda: states and all(each.service_is_ready() for each in clients), PATIENCE
    ), box.stderr

    def largest():
        return max(
            (
                np.hypot(
                    np.hypot(each.wrench.torque.x, each.wrench.torque.y), each.wrench.torque.z
                )
                for _, each in felt
            ),
            default=0.0,
        )

    end = time.monotonic() + 2.0 * PATIENCE
    while largest() < 0.05 and time.monotonic() < end:
        # Again, where a pause of the machine ended it.
        for client in clients:
            future = client.call_async(Trigger.Request())
            assert observer.spin_until(future.done, PATIENCE)
        observer.spin_until(lambda: largest() > 0.05, 3.0)
    assert 0.05 <= largest() <= 0.35, (states[-1][1].data, box.stderr)
    assert 'engaged' in {message.data for _, message in states}
