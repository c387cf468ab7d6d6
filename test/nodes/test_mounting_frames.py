# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A mounted device in real nodes: outputs in the table's frame, transforms for tf."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    QuaternionStamped,
    TwistStamped,
)
from harness import SIM, stamp, status
import numpy as np
import pytest
from recording import quaternions, stamps
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import dexterity, matrix_from_quaternion, matrix_from_zxz
from spm_haptic_master.nodes.mounting_frames import static_transforms
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.supervision import supervise
from std_msgs.msg import Float64MultiArray

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
BASE_DEG, HANDLE_DEG = [30.0, 40.0, -70.0], [0.0, 0.0, 45.0]
TABLE, HANDLE = (matrix_from_zxz(*np.radians(angles)) for angles in (BASE_DEG, HANDLE_DEG))
MOUNTED = {'mounting.base_zxz_deg': BASE_DEG, 'mounting.handle_zxz_deg': HANDLE_DEG,
           'mounting.table_frame_id': 'operating_table'}
TURNING = {**SIM, 'sim.trajectory': 'sweep', 'rate': 200.0, 'velocity_window': 0.1}


@pytest.mark.process
def test_all_outputs_are_those_of_the_handle_on_the_table(start, observer):
    samples = observer.collect(JointState, 'measured_js')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    poses = observer.collect(PoseStamped, 'measured_cp')
    covariances = observer.collect(PoseWithCovarianceStamped, 'pose_with_covariance')
    twists = observer.collect(TwistStamped, 'measured_cv')
    dexterities = observer.collect(Float64MultiArray, 'dexterity')
    health = observer.collect(DiagnosticArray, '/diagnostics')
    start('master', parameters={**TURNING, **MOUNTED})
    assert observer.spin_until(
        lambda: all(len(each) > 100 for each in (orientations, poses, covariances, twists))
        and len(dexterities) > 20 and status(health, 'diagnostics: singularity'), PATIENCE)
    for arrived in (orientations, poses, covariances, twists):
        assert {message.header.frame_id for _, message in arrived} == {'operating_table'}

    # The same samples through the supervision, without the mounting.
    times = stamps(samples)
    found = supervise(times, [list(message.position) for _, message in samples],
                      start_samples=1, rate=200.0)
    plain = matrix_from_quaternion(found.quaternion[found.published])
    of_time = dict(zip(times[found.published], range(len(plain)), strict=True))
    known = [(of_time[stamp(message)], place) for place, (_, message) in enumerate(orientations)
             if stamp(message) in of_time]
    assert len(known) > 90
    rows, places = np.array(known).T
    published = matrix_from_quaternion(quaternions(orientations))[places]
    # A step more or less of the estimate's iteration.
    assert np.abs(published - TABLE @ plain[rows] @ HANDLE).max() < 1e-4

    rotation = {stamp(message): matrix_from_quaternion([
        message.quaternion.x, message.quaternion.y, message.quaternion.z, message.quaternion.w])
        for _, message in orientations}
    for _, message in poses[:50]:
        q = message.pose.orientation
        np.testing.assert_array_equal(
            matrix_from_quaternion([q.x, q.y, q.z, q.w]), rotation[stamp(message)])
    spread = {when: found.covariance[found.published][row] for when, row in of_time.items()}
    compared = [(np.reshape(message.pose.covariance, (6, 6))[3:, 3:],
                 TABLE @ spread[stamp(message)] @ TABLE.T)
                for _, message in covariances if stamp(message) in spread]
    assert len(compared) > 50
    for got, expected in compared:
        np.testing.assert_allclose(got, expected, rtol=0.0, atol=0.01 * np.abs(expected).max())
    # The rotation between two orientations 0.1 s apart, in the table's frame.
    moved = [(angular(message), turn_rate(rotation[when - late], rotation[when]))
             for _, message in twists if (when := stamp(message)) in rotation
             for late in [when - min(rotation, key=lambda t, when=when: abs(t - when + 10**8))]
             if 9e7 < late < 11e7]
    assert len(moved) > 20
    got, expected = np.array(moved)[:, 0], np.array(moved)[:, 1]
    # Both have noise of 0.04 deg a sensor, but it is not the one in the base frame.
    in_table, in_base = (np.linalg.norm(got - rate, axis=1).mean()
                         for rate in (expected, expected @ TABLE))
    print(f'velocity off by {in_table:.4f} rad/s, in the base frame by {in_base:.4f}')
    assert in_table < 0.5 * in_base
    # The diagnostics take the mounting off again.
    eta = [dexterity(plain[row]) for row in rows]
    published_eta = [message.data[0] for _, message in dexterities]
    assert min(eta) - 0.02 < np.median(published_eta) < max(eta) + 0.02


def angular(message):
    """Return the angular velocity of a twist, rad/s."""
    velocity = message.twist.angular
    return velocity.x, velocity.y, velocity.z


def turn_rate(before, after, seconds=0.1):
    """Return the mean angular velocity between two orientations, rad/s."""
    turn = after @ before.T
    return tuple(np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0],
                           turn[1, 0] - turn[0, 1]]) / 2.0 / seconds)


@pytest.mark.process
def test_the_frames_are_on_diagnostics_and_on_tf_where_it_is_installed(start, observer):
    health = observer.collect(DiagnosticArray, '/diagnostics')
    start('fkm', parameters=MOUNTED)
    assert observer.spin_until(lambda: status(health, 'fkm: orientation'), PATIENCE)
    text = {value.key: value.value
            for value in status(health, 'fkm: orientation').values}['mounting']
    assert text.startswith('spm_base on operating_table, spm_handle on spm_platform')
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        assert text.endswith(' (not on /tf_static: no tf2_msgs)')
        return
    late = observer.collect(TFMessage, '/tf_static', STATE)
    assert observer.spin_until(lambda: late, PATIENCE)
    assert [each.child_frame_id for each in late[0][1].transforms] == ['spm_base', 'spm_handle']


def test_static_transforms_are_the_rotations_of_the_mounting():
    table, handle = static_transforms(complete(FKM_SETTINGS, MOUNTED))
    assert (table.header.frame_id, table.child_frame_id) == ('operating_table', 'spm_base')
    assert (handle.header.frame_id, handle.child_frame_id) == ('spm_platform', 'spm_handle')
    for transform, expected in ((table, TABLE), (handle, HANDLE)):
        q, moved = transform.transform.rotation, transform.transform.translation
        np.testing.assert_allclose(
            matrix_from_quaternion([q.x, q.y, q.z, q.w]), expected, rtol=0.0, atol=1e-14)
        assert (moved.x, moved.y, moved.z) == (0.0, 0.0, 0.0)
    only, = static_transforms(complete(FKM_SETTINGS, {'mounting.handle_zxz_deg': HANDLE_DEG}))
    assert only.child_frame_id == 'spm_handle'
    assert static_transforms(complete(FKM_SETTINGS, {})) == []
