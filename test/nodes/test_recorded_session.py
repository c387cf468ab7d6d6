# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The main job: a recorded CAN session becomes orientations, over real processes and DDS."""

import gzip

from disturbance import Disturbance
from geometry_msgs.msg import QuaternionStamped
import numpy as np
import pytest
from recording import check_against_truth, LOG, stamps, truth
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = [pytest.mark.process, pytest.mark.alone]

# Pace of the replay: twice that of the recording, as of a rig at 2 kHz.
PACE = 2.0
# Time for a program to start and for the topics to be matched (s).
PATIENCE = 60.0


def begin_of_log(path, sets):
    """Write the begin of the recording, of so many sets: its half is singular twice as well."""
    written = 0
    with gzip.open(LOG, 'rt') as source, gzip.open(path, 'wt', compresslevel=1) as log:
        for line in source:
            written += ' 080#' in line
            if written > sets:
                break
            log.write(line)
    return path


@pytest.mark.parametrize('sets', [10_000, pytest.param(20_000, marks=pytest.mark.evidence)])
def test_a_recorded_session_becomes_orientations(start, observer, tmp_path, sets):
    log = begin_of_log(tmp_path / 'session.log.gz', sets)
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
                'replay.path': log,
                'replay.rate': PACE,
                **simulated_rig(),
            },
        )
        assert observer.spin_until(lambda: driver.poll() is not None, PATIENCE)
        observer.spin(0.5)
        assert driver.wait() == 0
        assert f'{sets} sets' in driver.stdout
        fkm.stop()
        return len(orientations)

    with Disturbance() as machine:
        count = replay()
    machine.expect(count >= 0.999 * sets, count)
    # The replay shifts the stamps by a constant and scales them; the last set has an orientation.
    times = truth()[0][:sets]
    found = times[-1] + (stamps(orientations) - stamps(orientations)[-1]) * PACE
    index = np.searchsorted(times, found - 300_000)
    assert np.abs(times[index] - found).max() < 300_000
    assert (np.diff(index) > 0).all()
    check_against_truth(orientations, index)
