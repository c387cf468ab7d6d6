# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The main job: a recorded CAN session becomes orientations, over real processes and DDS."""

import gzip
from itertools import islice
import sys

from disturbance import measure_undisturbed
from geometry_msgs.msg import QuaternionStamped
from harness import stamp, start_command
import numpy as np
import pytest
from recording import (
    check_against_truth,
    check_each_against_truth,
    LOG,
    quaternions,
    recorded_angles,
    stamps,
)
import rig_as_built
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.parameters.files import simulated_rig

pytestmark = [pytest.mark.process, pytest.mark.alone]

# Sets that are played onto the live bus: the first half passes the singularity twice.
PLAYED = 10_000
FRAMES_A_SET = 5
# Pace of the replay: twice that of the recording, as of a rig at 2 kHz; time between two sets in
# the recording (ns).
PACE, PERIOD = 2.0, 1_000_000
# Time for a program to start and for the topics to be matched (s).
PATIENCE = 60.0


@pytest.fixture(scope='module')
def played_log(tmp_path_factory):
    """Write the recording's first half."""
    path = tmp_path_factory.mktemp('log') / 'played.log'
    with gzip.open(LOG, 'rt') as file:
        path.write_text(''.join(islice(file, FRAMES_A_SET * PLAYED)))
    return path


def index_by_counts(samples, orientations):
    """
    Return the SYNC index of each orientation: a sample's counts, noise and all, show it.

    It is -1 for a sample that is no set of the log: on a disturbed machine the player sends frames
    late and in a burst, and of such cycles the kernel drops parts.
    """
    sent = {}
    for index, angles in enumerate(recorded_angles()):
        sent.setdefault(tuple(angles.round(9)), []).append(index)
    index_of_stamp, expected = {}, 0
    for _, sample in samples:
        later = [index for index in sent.get(tuple(np.round(sample.position, 9)), ())
                 if index >= expected]
        if later:
            index_of_stamp[stamp(sample)] = later[0]
            expected = later[0] + 1
        else:
            print(f'no set of the log: {sample.position}')
    return np.array([index_of_stamp.get(when, -1) for when in stamps(orientations)])


def test_log_played_onto_a_live_bus_becomes_orientations(
        start, observer, bus_channel, played_log):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    samples = observer.collect(JointState, 'measured_js')

    def play():
        nodes = [start('fkm'), start('encoder_driver', parameters={
            'source': 'can', 'can.interface': 'udp_multicast', 'can.channel': bus_channel,
            **simulated_rig()})]
        assert observer.spin_until(
            lambda: observer.node.count_publishers('orientation') == 1
            and observer.node.count_publishers('measured_js') == 1
            and observer.node.count_subscribers('measured_js') == 2, PATIENCE)
        observer.spin(0.5)
        orientations.clear()
        samples.clear()
        player = start_command([sys.executable, '-m', 'can.player', '-i', 'udp_multicast',
                                '-c', bus_channel, str(played_log)])
        assert observer.spin_until(lambda: player.poll() is not None, PATIENCE)
        assert player.wait() == 0
        observer.spin(0.5)
        for node in nodes:
            node.stop()
        index = index_by_counts(samples, orientations)
        if (index >= 0).all():
            # Whatever was lost: what was published is right.
            check_each_against_truth(orientations, index)
        assert all(arrival > stamp(message) for arrival, message in orientations)
        return index

    index = measure_undisturbed(
        play, lambda index: len(index) >= 0.99 * PLAYED and (index >= 0).all())
    print(f'{len(samples)} samples, {len(orientations)} orientations')
    assert len(index) >= 0.99 * PLAYED
    assert (index >= 0).all()
    assert (np.diff(index) > 0).all()
    check_against_truth(orientations, index)
    # The stamps are those of SYNC on this bus, at the player's pace.
    took = (stamps(orientations)[-1] - stamps(orientations)[0]) * 1e-9
    assert (index[-1] - index[0]) / took == pytest.approx(1000.0, rel=0.05)


def test_a_recorded_rig_with_tolerances_becomes_orientations(start, observer, tmp_path):
    calibration_file = tmp_path / 'calibration.yaml'
    calibration_file.write_text('/**:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n'.replace('True', 'true') for name, value in (
            rig_as_built.calibration() | rig_as_built.mechanism()).items()))
    orientations = observer.collect(QuaternionStamped, 'orientation')

    def replay():
        fkm = start('fkm', '--params-file', str(calibration_file),
                    parameters={'rate': 1000.0 * PACE})
        assert observer.spin_until(
            lambda: observer.node.count_publishers('orientation') == 1, PATIENCE)
        orientations.clear()
        driver = start('encoder_driver', '--params-file', str(calibration_file), parameters={
            'source': 'replay', 'replay.path': rig_as_built.LOG, 'replay.rate': PACE})
        assert observer.spin_until(lambda: driver.poll() is not None, PATIENCE)
        observer.spin(0.5)
        assert driver.wait() == 0
        assert f'{rig_as_built.SETS} sets' in driver.stdout
        fkm.stop()
        print(f'{len(orientations)} orientations')
        return len(orientations)

    count = measure_undisturbed(replay, lambda found: found >= 0.999 * rig_as_built.SETS)
    assert count >= 0.999 * rig_as_built.SETS
    # Every tenth set has its truth. The replay shifts the stamps by a constant and scales them;
    # fkm withholds the first few samples.
    since = (stamps(orientations) - stamps(orientations)[0]) * PACE
    times, true = rig_as_built.truth()
    wanted = (times - times[0]) * 1e9
    errors = min((errors_at(since + first * PERIOD, wanted, orientations, true)
                  for first in range(20)), key=np.max)
    rms = np.sqrt((errors**2).mean())
    print(f'{count} orientations, rms {rms:.4f} deg, largest {errors.max():.3f} deg')
    assert len(errors) >= 1990
    assert rms <= 0.055 and errors.max() <= 0.3


def errors_at(since, wanted, orientations, true):
    """Return the errors, deg, where an orientation is at a wanted time, ns, of the recording."""
    index = np.minimum(np.searchsorted(since, wanted - 0.3 * PERIOD), len(since) - 1)
    known = np.abs(since[index] - wanted) < 0.3 * PERIOD
    found = matrix_from_quaternion(quaternions(orientations)[index[known]])
    return rig_as_built.errors_deg(found, true[known])
