# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a client's wrench to the drives: a master between simulated encoders and drives."""

from benchmarks.pipeline.child_process import wait_until
import force_client
from force_client import PATIENCE
from harness import Observer, SIMULATED, SIMULATED_CHECK
import numpy as np
import pytest
from spm_haptic_master.force import ForceCondition

pytestmark = pytest.mark.process

# Time-outs that other programs of this machine do not exhaust (s).
BUS = {
    'rate': 500.0,
    'drives.rated_torque': [0.5],
    'drives.event_timer': 0.5,
    'drives.status_timeout': 1.0,
    'drives.heartbeat_timeout': 0.5,
}
POSE = {'sim.trajectory': 'fixed', 'sim.pose_deg': [130.0, 50.0, 20.0]}
MASTER = {
    'source': 'can',
    'can.timeout': 0.5,
    'max_age': 2.0,
    'alert_limit_deg': 5.0,
    'crtk_rate': 0.0,
}


@pytest.mark.alone
def test_drives_make_what_the_client_commands_and_their_loss_is_a_fault(start, bus_channel):
    bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel}
    devices = start(
        'sim_bus', '--sync', '--drives', '3', *SIMULATED, parameters={**bus, **BUS, **POSE}
    )
    assert wait_until(lambda: 'four encoders' in devices.stdout, PATIENCE), devices.stderr
    master = start(
        'master',
        *SIMULATED,
        '-r',
        '__ns:=/driven',
        parameters={
            **MASTER,
            **bus,
            **BUS,
            **force_client.FORCE,
            'force.without_drives': False,
            'drives.check_file': str(SIMULATED_CHECK),
            'drives.interface': 'udp_multicast',
            'drives.channel': bus_channel,
        },
    )
    observer = Observer()
    try:
        client = force_client.Client(observer, '/driven')

        def made():
            """Whether the drives report the torque that is commanded."""
            commanded = client.entry()[1].get('motor torque (N m)', '')
            effort = client.joints[-1][1].effort
            return (
                commanded
                and max(map(abs, effort)) > 0.02
                and np.abs(
                    np.subtract(effort[:3], [float(each) for each in commanded.split()])
                ).max()
                < 0.005
            )

        assert client.feels(force_client.TORQUE, made), (master.stderr, client.entry())
        assert client.entry()[1]['drives'] == 'in operation'
        client.torque = (0.0, 0.0, 0.0)
        devices.kill()
        assert client.awaits(ForceCondition.FAULT)
        assert observer.spin_until(
            lambda: client.entry()[1].get('drives', '') not in ('in operation', ''), PATIENCE
        )
    finally:
        observer.close()
    assert master.stop() == 0
    assert 'Traceback' not in master.stderr
