# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback of a running master, by its topics: a client commands, and looks what it gets."""

from contextlib import contextmanager
from pathlib import Path
import re

from benchmarks.pipeline.child_process import wait_until
from disturbance import Disturbance
from force_client import Client, FORCE, PATIENCE, TORQUE
from geometry_msgs.msg import WrenchStamped
from harness import Observer, SIM, stamp, start_program
import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from spm_haptic_master.kinematics import matrix_from_zxz

pytestmark = pytest.mark.process

# A device at rest, away from the singularity of three motors; its samples are not to be late on a
# busy machine.
POSE_DEG = [130.0, 50.0, 20.0]
MASTER = {
    **SIM,
    'sim.trajectory': 'fixed',
    'sim.pose_deg': POSE_DEG,
    'rate': 500.0,
    'crtk_rate': 0.0,
    'max_age': 2.0,
    'alert_limit_deg': 5.0,
}
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
FORCE_TOPICS = {
    'servo_cf',
    'spatial/servo_cf',
    'body/servo_cf',
    'spatial/measured_cf',
    'body/measured_cf',
    'use_gravity_compensation',
    'lock_orientation',
    'unlock_orientation',
    'hold',
    'free',
    'force_scale',
    'force_state',
    'body/set_cf_orientation_absolute',
}


@contextmanager
def running(arm, **parameters):
    """Yield an observer beside a running master in a namespace, and the master."""
    program = start_program('master', '-r', f'__ns:={arm}', parameters={**MASTER, **parameters})
    observer = Observer()
    try:
        yield observer, program
    finally:
        observer.close()
        code = program.stop()
    assert code == 0 and 'Traceback' not in program.stderr, program.stderr


@pytest.fixture(scope='module')
def master():
    """One master for most tests."""
    with running('/felt', **FORCE) as (_, program):
        yield program


@pytest.fixture
def arm(master):
    """Give its namespace."""
    return '/felt'


def test_crtks_haptic_example_is_felt(arm, observer):
    """
    What its box sends: 200 Hz, reliable, of depth 10, an empty header, zero inside the box.

    The box of the example is one of positions; a device that turns has a box of angles.
    """
    client = Client(observer, arm)
    assert client.feels(TORQUE, lambda: abs(client.figure('rendered fraction') - 1.0) < 0.02)
    assert client.entry()[0] == 'engaged'
    assert client.feels(
        TORQUE, lambda: any(abs(each) > 0.01 for each in client.joints[-1][1].effort)
    )
    effort = client.joints[-1][1].effort
    assert len(effort) == 4
    assert effort[3] == 0.0
    client.torque = (0.0, 0.0, 0.0)


def test_a_best_effort_publisher_in_the_handles_frame_is_heard(arm, observer):
    client = Client(observer, arm, 'body/servo_cf', BEST_EFFORT)
    body = observer.collect(WrenchStamped, f'{arm}/body/measured_cf')

    def is_felt():
        t = body[-1][1].wrench.torque if body else None
        return t is not None and np.abs(np.subtract(TORQUE, (t.x, t.y, t.z))).max() < 0.01

    turned = matrix_from_zxz(*np.radians(POSE_DEG)) @ TORQUE
    assert client.feels(TORQUE, is_felt, turned)
    assert body[-1][1].header.frame_id == 'spm_platform'


@pytest.mark.alone
def test_a_wrench_is_rendered_a_period_and_3_ms_after_it_was_sent(observer):
    """By the stamp of the first sample that renders it: 99 % of a hundred changes."""
    with running('/quick', **FORCE):
        client = Client(observer, '/quick')
        assert client.feels((0.0, 0.0, 0.1))
        del client.felt[:], client.changed[:]
        with Disturbance() as machine:
            for number in range(101):
                client.torque = (0.0, 0.0, 0.06 if number % 2 else 0.1)
                observer.spin(0.04)
        times = np.array([stamp(each) for _, each in client.felt])
        torques = np.array([each.wrench.torque.z for _, each in client.felt])
        late = []
        for sent in client.changed:
            after = np.searchsorted(times, sent)
            changed = np.abs(torques[after:] - torques[after - 1]) > 0.002
            late.append(
                1e-6 * (times[after + np.argmax(changed)] - sent) if changed.any() else 1e3
            )
        limit = 1e3 / MASTER['rate'] + 3.0
        machine.expect(
            len(late) == 100 and np.percentile(late, 99, method='lower') <= limit,
            f'{len(late)} changes, p50, p99 {np.percentile(late, [50, 99])} ms',
        )


def test_nothing_is_sent_through_shared_memory(master, arm, observer):
    """A9: Fast DDS has threads for it; a stopped reader may hold a mutex that sending needs."""
    assert observer.spin_until(
        lambda: observer.node.count_publishers(f'{arm}/orientation'), PATIENCE
    )
    names = [path.read_text() for path in Path(f'/proc/{master.pid}/task').glob('*/comm')]
    assert any(name.startswith('dds.udp') for name in names)
    assert not [name for name in names if name.startswith('dds.shm')]


def test_the_status_of_master_has_the_state(master):
    assert wait_until(
        lambda: re.search(r', force (off|ready|engaged|fault: |fading: )', master.stdout), PATIENCE
    )


def test_with_force_its_topics_exist(arm, observer):
    assert observer.spin_until(
        lambda: (
            {f'{arm}/{topic}' for topic in FORCE_TOPICS}
            <= {name for name, _ in observer.node.get_topic_names_and_types()}
        ),
        PATIENCE,
    )
