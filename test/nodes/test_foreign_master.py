# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Four encoders of another stack without any optional object: scan, set-up, and a master."""

from math import acos, degrees, radians

from encoder_frames import LAYOUTS
from foreign_nodes import BARE, foreign_bus, objects_of
from geometry_msgs.msg import QuaternionStamped
from harness import SIMULATED
import numpy as np
import pytest
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    measured_angles,
    workspace_pose,
)
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.tools import can_scan, can_setup, command_line
from std_msgs.msg import String

pytestmark = pytest.mark.process

NODES = (1, 2, 3, 4)
# Time that a busy machine may need for a program (s), and time-outs that it keeps.
PATIENCE = 60.0
SLOW = {
    'rate': 50.0,
    'can.timeout': 0.5,
    'encoders.window': 0.04,
    'sample_timeout': 0.5,
}
POSE = workspace_pose(radians(5.0), 0.5, radians(20.0))


def check_scan(arguments, capsys):
    """Check that `can_scan` starts the encoders and finds all of them."""
    code = can_scan.main(['can_scan', *arguments, '-p', 'rate:=50.0', '--start'])
    said = capsys.readouterr().out
    assert 'all four encoders are there, as configured' in said, said
    assert code == 0


def check_setup(arguments, capsys):
    """Check that `can_setup` writes the objects that there are, and names the others."""
    code = can_setup.main(['can_setup', *arguments, '--write'])
    said = capsys.readouterr().out
    assert said.count('4 of 4 objects as configured') == 4, said
    assert 'not stored by this run: it cannot store (0x1010:01)' in said
    assert 'no object has its counts per turn' in said
    assert code == 0


def error(message):
    """Return the angle from the pose of the encoders to a published orientation, deg."""
    q = message.quaternion
    turn = matrix_from_quaternion([q.x, q.y, q.z, q.w]).T @ POSE
    return degrees(acos(min(1.0, 0.5 * (np.trace(turn) - 1.0))))


def test_encoders_without_any_optional_object_come_up_to_an_orientation(
    start, observer, bus_channel, stack, capsys, monkeypatch
):
    monkeypatch.setattr(command_line, 'SIGNALS', ())
    bus = {'can.interface': 'udp_multicast', 'can.channel': bus_channel}
    arguments = [part for name, value in bus.items() for part in ('-p', f'{name}:={value}')]
    encoders = stack.enter_context(
        foreign_bus(
            bus_channel,
            *((node, objects_of(node, **BARE)) for node in NODES),
            interface='udp_multicast',
        )
    )
    angles = measured_angles(
        tuple(POSE.ravel().tolist()),
        Geometry(),
        (1, 1, 1),
        4,
    )
    for encoder, layout, angle in zip(encoders, LAYOUTS, angles, strict=True):
        encoder.counts = int.from_bytes(layout.data(angle), 'little')

    check_scan(arguments, capsys)
    check_setup(arguments, capsys)
    orientations = observer.collect(QuaternionStamped, 'orientation')
    states = observer.collect(String, 'state', STATE)
    parameters = {
        'source': 'can',
        'can.sync': 'produce',
        **bus,
        **SLOW,
    }
    master = start('master', *SIMULATED, parameters=parameters)
    found = observer.spin_until(lambda: len(orientations) > 20, PATIENCE)
    assert found, (master.stderr, [message.data for _, message in states])
    assert error(orientations[-1][1]) < 0.1
    assert states[-1][1].data == 'healthy'
    assert all(encoder.operational for encoder in encoders)
    assert master.stop() == 0
