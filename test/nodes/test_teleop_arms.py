# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two arms as teleop.launch.py starts them: each with its pedals, slave and registration."""

from contextlib import ExitStack

from benchmarks.surgeon import Surgeon
from harness import environment, ROOT
from mechanism import zxz
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import executable, Program, wait_until
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.nodes.launch_plan import Follower, plan

pytestmark = pytest.mark.process

# A pause of a busy machine is no silence; the slave is not to lag.
CONFIG = """
/**:
  ros__parameters: {rate: 100.0}
/**/encoder_driver:
  ros__parameters: {sim: {trajectory: sweep, noise_deg: 0.001}}
/**/fkm:
  ros__parameters: {sample_timeout: 2.0, max_age: 2.0}
/**/teleop:
  ros__parameters:
    teleop: {orientation_timeout: 1.0, slave_timeout: 2.0, presence_timeout: 2.0,
             registration_zxz_deg: [%s]}
"""
# Registrations of the two arms (deg).
TURNS = {'left': (90.0, 0.0, 0.0), 'right': (20.0, -60.0, 130.0)}


def matrix(arrived):
    return matrix_from_quaternion(arrived.quaternion)


@pytest.fixture
def arms(tmp_path):
    """Start both arms, and yield a surgeon for each."""
    with ExitStack() as stack:
        for arm, turn in TURNS.items():
            config = tmp_path / f'{arm}.yaml'
            config.write_text(CONFIG % ', '.join(map(str, turn)))
            for process in plan(
                    'sim', str(config), '', arm, True, Follower(), frame_prefix=f'{arm}/'):
                stack.enter_context(Program(
                    executable(process.executable, *process.arguments, '-r', f'__ns:=/{arm}'),
                    environment=environment(), directory=ROOT))
        yield {arm: stack.enter_context(Surgeon(orientations=True, namespace=arm))
               for arm in TURNS}


def test_each_arm_follows_its_own_surgeon_and_registration(arms):
    assert all(surgeon.await_ready(60.0) for surgeon in arms.values())
    left, right = arms['left'], arms['right']
    assert left.engage(60.0), left.state
    assert wait_until(lambda: len(left.commands) > 50, 30.0)
    assert right.commands == [] and right.state.startswith('disengaged: ')
    assert right.engage(60.0), right.state
    for arm, surgeon in arms.items():
        first = surgeon.commands[0]
        assert wait_until(lambda first=first, surgeon=surgeon: rotation_distance(
            first.quaternion, surgeon.commands[-1].quaternion) > 0.03, 60.0), surgeon.state
        # R_cmd R_s0^T is the motion of the hand, in the slave's base frame.
        registration = zxz(*np.radians(TURNS[arm]))
        masters = {each.stamp: matrix(each) for each in surgeon.orientations}
        last = next(each for each in reversed(surgeon.commands) if each.stamp in masters)
        hand = masters[last.stamp] @ masters[first.stamp].T
        np.testing.assert_allclose(
            matrix(last) @ matrix(first).T, registration @ hand @ registration.T, atol=2e-3)
    left.press('presence', False)
    assert left.await_state('disengaged', 20.0)
    count = len(right.commands)
    assert wait_until(lambda: len(right.commands) > count + 20, 20.0)
