# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slave in examples/ follows as it is written there."""

from benchmarks.surgeon import Surgeon
from harness import ROOT, SIM, start_program
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.kinematics.rotations import rotation_distance

pytestmark = pytest.mark.process

# A pause of a busy machine is no silence.
PATIENT = {**SIM, 'rate': 200, 'sample_timeout': 2.0, 'max_age': 2.0, 'teleop.run': True,
           'teleop.orientation_timeout': 1.0, 'teleop.slave_timeout': 2.0,
           'teleop.presence_timeout': 2.0}


def test_the_slave_of_the_example_follows(start_python):
    start_python(str(ROOT / 'examples' / 'slave.py'))
    master = start_program('master', parameters={**PATIENT, 'sim.trajectory': 'sweep'})
    try:
        with Surgeon() as surgeon:
            assert surgeon.await_ready(60.0) and surgeon.engage(60.0), surgeon.state
            # It begins where the slave is.
            first = surgeon.commands[0].quaternion
            assert rotation_distance(first, surgeon.poses[0].quaternion) < 1e-9
            assert wait_until(lambda: rotation_distance(
                first, surgeon.commands[-1].quaternion) > 0.05, 60.0), surgeon.state
            surgeon.press('presence', False)
            assert surgeon.await_state('disengaged', 20.0)
            assert surgeon.await_rest(lambda: len(surgeon.commands), 0.5, 20.0)
            last = surgeon.commands[-1].quaternion
            assert wait_until(lambda: rotation_distance(
                last, surgeon.poses[-1].quaternion) < 1e-3, 20.0)
            stamps = [each.stamp for each in surgeon.commands]
            assert np.all(np.diff(stamps) > 0)
    finally:
        assert master.stop() == 0
