# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig with ordinary tolerances, from its recorded CAN frames through driver and fkm."""

from disturbance import measure_undisturbed
from geometry_msgs.msg import QuaternionStamped
import numpy as np
import pytest
from recording import quaternions, stamps
from rig_as_built import calibration, errors_deg, LOG, mechanism, SETS, truth
from spm_haptic_master.kinematics import matrix_from_quaternion

pytestmark = [pytest.mark.process, pytest.mark.alone]

# Time for a program to start and for the topics to be matched (s).
PATIENCE = 60.0
# Pace of the replay: twice that of the recording, as of a rig at 2 kHz.
PACE = 2.0
# Time between two sets in the recording (ns).
PERIOD = 1_000_000


@pytest.fixture
def calibration_file(tmp_path):
    """Write the one file that all nodes take."""
    path = tmp_path / 'calibration.yaml'
    path.write_text('/**:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n'.replace('True', 'true')
        for name, value in (calibration() | mechanism()).items()))
    return path


def test_a_rig_with_tolerances_becomes_orientations(start, observer, calibration_file):
    orientations = observer.collect(QuaternionStamped, 'orientation')

    def replay():
        fkm = start('fkm', '--params-file', str(calibration_file),
                    parameters={'rate': 1000.0 * PACE})
        assert observer.spin_until(
            lambda: observer.node.count_publishers('orientation') == 1, PATIENCE)
        orientations.clear()
        driver = start('encoder_driver', '--params-file', str(calibration_file), parameters={
            'source': 'replay', 'replay.path': LOG, 'replay.rate': PACE})
        assert observer.spin_until(lambda: driver.poll() is not None, PATIENCE)
        observer.spin(0.5)
        assert driver.wait() == 0
        assert f'{SETS} sets' in driver.stdout
        fkm.stop()
        print(f'{len(orientations)} orientations')
        return len(orientations)

    count = measure_undisturbed(replay, lambda found: found >= 0.999 * SETS)
    assert count >= 0.999 * SETS
    # Every tenth set has its truth. The replay shifts the stamps by a constant and scales them;
    # fkm withholds the first few samples.
    since = (stamps(orientations) - stamps(orientations)[0]) * PACE
    times, true = truth()
    wanted = (times - times[0]) * 1e9
    errors = min((errors_at(since + first * PERIOD, wanted, orientations, true)
                  for first in range(20)), key=np.max)
    rms = np.sqrt((errors**2).mean())
    print(f'{count} of {SETS} orientations, rms {rms:.4f} deg, largest {errors.max():.3f} deg')
    assert len(errors) >= 1990
    assert rms <= 0.055 and errors.max() <= 0.3


def errors_at(since, wanted, orientations, true):
    """Return the errors, deg, where an orientation is at a wanted time, ns, of the recording."""
    index = np.minimum(np.searchsorted(since, wanted - 0.3 * PERIOD), len(since) - 1)
    known = np.abs(since[index] - wanted) < 0.3 * PERIOD
    return errors_deg(matrix_from_quaternion(quaternions(orientations)[index[known]]),
                      true[known])
