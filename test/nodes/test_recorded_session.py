# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The main job: a recorded CAN session becomes orientations, over real processes and DDS."""

from disturbance import Disturbance
from geometry_msgs.msg import QuaternionStamped
import numpy as np
import pytest
from recording import check_against_truth, LOG, stamps, truth
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = [pytest.mark.process, pytest.mark.alone]

# Pace of the replay: twice that of the recording, as of a rig at 2 kHz.
PACE = 2.0
# Sets in the recording.
SETS = 20_000
# Time for a program to start and for the topics to be matched (s).
PATIENCE = 60.0


def test_a_recorded_session_becomes_orientations(start, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')

    def replay():
        fkm = start('fkm', parameters={'rate': 1000.0 * PACE})
        assert observer.spin_until(
            lambda: observer.node.count_publishers('orientation') == 1, PATIENCE
        )
        orientations.clear()
        driver = start(
            'encoder_driver',
            parameters={
                'source': 'replay',
                'replay.path': LOG,
                'replay.rate': PACE,
                **simulated_rig(),
            },
        )
        assert observer.spin_until(lambda: driver.poll() is not None, PATIENCE)
        observer.spin(0.5)
        assert driver.wait() == 0
        assert f'{SETS} sets' in driver.stdout
        fkm.stop()
        return len(orientations)

    with Disturbance() as machine:
        count = replay()
    machine.expect(count >= 0.999 * SETS, count)
    # The replay shifts the stamps by a constant and scales them; the last set has an orientation.
    times = truth()[0]
    found = times[-1] + (stamps(orientations) - stamps(orientations)[-1]) * PACE
    index = np.searchsorted(times, found - 300_000)
    assert np.abs(times[index] - found).max() < 300_000
    assert (np.diff(index) > 0).all()
    check_against_truth(orientations, index)
