# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded samples through the supervision, in Python: what goes in, and what comes out."""

from device import encoders, joint_angles, motion, offset, run, stamps
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision import recording, supervise, Supervised
from spm_haptic_master.supervision.supervisor import make_supervisor

TIMES = stamps(60)
READINGS = encoders(joint_angles(motion('rest', 0.06)))
G = Geometry()


@pytest.fixture(scope='module')
def found():
    """Return the supervised recording of a device at rest."""
    return supervise(TIMES, READINGS)


def test_each_sample_is_what_the_supervisor_returns(found):
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, {}))
    for index, row in enumerate(READINGS.tolist()):
        verdict = supervisor.take(int(TIMES[index]), tuple(row))
        assert tuple(found.unchecked[index]) == supervisor.unchecked()
        if verdict.estimate is not None:
            assert tuple(found.quaternion[index]) == verdict.estimate.quaternion
            assert tuple(found.covariance[index].ravel()) == verdict.estimate.covariance
            level = np.radians(found.protection_level[index])
            assert level == pytest.approx(verdict.protection_level)


def test_what_is_not_published_is_no_number(found):
    assert isinstance(found, Supervised)
    assert found.published.dtype == bool
    assert found.state == [(0, 'starting'), (4, 'healthy')]
    assert np.flatnonzero(~found.published).tolist() == [0, 1, 2, 3]
    for values, shape in (
        (found.quaternion, (60, 4)),
        (found.covariance, (60, 3, 3)),
        (found.protection_level, (60,)),
    ):
        assert values.shape == shape
        assert np.isnan(values[:4]).all()
        assert np.isfinite(values[4:]).all()


def test_the_orientations_are_the_true_ones(found):
    true = quaternion_from_matrix(motion('rest', 0.06))
    half_cosine = np.abs((found.quaternion * true).sum(1))
    assert half_cosine[4:].min() > np.cos(np.radians(0.2))


def test_which_sensors_are_checked_and_what_bounds_the_others(found):
    """
    Checked are th1A and th1B, which have no rival here; th3A has one until the device has turned.

    An unchecked sensor's fault is bounded by the distance of its rival.
    """
    assert found.unchecked.shape == (60, 4)
    assert np.isinf(found.unchecked[-1]).tolist() == [False, False, True, True]
    assert found.bounds.shape == (60, 4)
    assert (found.bounds[6:, :2] < 1.1).all()
    assert (found.bounds[-1, 2:] > 20.0).all()
    assert np.isfinite(found.bounds[-1]).all()


@pytest.mark.parametrize(
    ('change', 'withheld', 'states', 'reasons'),
    [
        # A silence of 20 ms changes the state, a shorter one does not.
        (
            [(30, 31, 2, np.nan), (40, 44, 0, np.inf)],
            [30, *range(40, 44)],
            [],
            {'joint_1c missing': 1, 'angle not finite': 4},
        ),
        (
            [(10, 20, 0, np.inf), (30, 60, 0, np.inf)],
            [*range(10, 20), *range(30, 60)],
            [(49, 'silent: angle not finite')],
            {'angle not finite': 40},
        ),
        # A fault does at once.
        (
            [(30, 31, 1, 0.1), (50, 60, 1, 0.1)],
            [30, *range(50, 60)],
            [(52, 'silent: joint_1b jumped')],
            {},
        ),
    ],
)
def test_what_is_withheld_and_why(change, withheld, states, reasons):
    readings = READINGS.copy()
    for first, last, sensor, added in change:
        readings[first:last, sensor] += added
    found = supervise(TIMES, readings)
    assert np.flatnonzero(~found.published).tolist() == [0, 1, 2, 3, *withheld]
    assert found.state[2:] == states
    assert reasons.items() <= found.reasons.items()


def test_no_samples_are_a_recording_and_lists_and_unsigned_stamps_are_arrays():
    nothing = supervise(np.zeros(0, int), np.zeros((0, 4)))
    assert len(nothing.published) == 0
    assert nothing.state == []
    assert nothing.unchecked.shape == (0, 4)
    unsigned = supervise(TIMES.astype(np.uint64), READINGS.tolist())
    assert unsigned.published.sum() == 56
    lists = supervise(TIMES.tolist(), READINGS.tolist())
    assert lists.published.sum() == 56


@pytest.mark.parametrize(
    ('parameters', 'published'),
    [
        ({'start_samples': 20}, 41),
        ({'alert_limit_deg': 0.01}, 0),
        ({'degraded': 'allow'}, 56),
        ({'geometry__alpha_deg': 39.3}, 56),
        ({'geometry__alpha_deg': 38.0}, 0),
        (
            {
                'bias_deg': np.full(4, 0.1),
                'alert_limit_deg': np.float64(2.0),
                'start_samples': np.int64(5),
            },
            56,
        ),
        ({'bias_deg': [np.float64(0.05)] * 4}, 56),
        # Axes may be matrices or numbers.
        *(
            (
                {
                    'geometry__base_axes': base,
                    'geometry__platform_axes': platform,
                    'geometry__proximal_deg': np.degrees(G.alphas),
                    'geometry__distal_deg': np.degrees(G.betas),
                },
                56,
            )
            for base, platform in (
                (G.base_axes, G.platform_axes),
                (np.array(G.base_axes), np.ravel(G.platform_axes)),
                (np.ravel(G.base_axes).tolist(), np.array(G.platform_axes).tolist()),
            )
        ),
    ],
)
def test_parameters_are_those_of_fkm(parameters, published):
    assert supervise(TIMES, READINGS, **parameters).published.sum() == published


@pytest.mark.parametrize(
    ('parameters', 'text'),
    [
        ({'sigma': 0.04}, 'sigma'),
        ({'geometry_alpha_deg': 39.3}, 'geometry_alpha_deg'),
        ({'geometry__alpha': 39.3}, r'geometry\.alpha'),
        ({'sigma_deg': 0.04}, 'sigma_deg'),
        ({'working_mode': [1, 1, 0]}, 'working_mode'),
        ({'geometry__base_axes': np.eye(2)}, r"'geometry\.base_axes' .* a list of 9"),
        # Nothing is published from four of six under the name of all.
        ({'sensors': 6}, "'sensors' is 6; expected 4, as angles have"),
    ],
)
def test_a_parameter_that_fkm_does_not_have_is_an_error(parameters, text):
    with pytest.raises(SettingError, match=text) as caught:
        supervise(TIMES, READINGS, **parameters)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('times', 'angles', 'text'),
    [
        *(
            (times, READINGS, text)
            for times, text in (
                (TIMES * 1e-9, 'float64'),
                (TIMES[:, None], r'\(60, 1\)'),
                (TIMES[:59], r'\(60, 4\)'),
                (None, 'stamps'),
                (TIMES > 0, 'bool'),
                (5, r'\(\)'),
                ([[1], [2, 3]], 'stamps'),
            )
        ),
        *(
            (TIMES, angles, 'angles')
            for angles in (
                READINGS[:, :3],
                READINGS[0],
                READINGS.T,
                READINGS[None],
                None,
                READINGS > 0.0,
                [*READINGS.tolist()[:-1], [1.0, 2.0]],
                READINGS.astype(complex),
                np.hstack([READINGS, READINGS])[:, :7],
            )
        ),
    ],
)
def test_stamps_and_angles_of_another_kind_are_an_error(times, angles, text):
    with pytest.raises(InputError, match=text) as caught:
        supervise(times, angles)
    assert '\n' not in str(caught.value)


def test_it_does_not_matter_when_a_recording_begins():
    """With times below 0 an excluded sensor was used again with the next sample that agreed."""
    fault = {'sensors': 6, 'change': offset(200, 1, 2.0, 300), 'recovery': 0.1}
    times = stamps(600)
    usual = run('turning', seconds=0.6, times=times, **fault)
    early = run('turning', seconds=0.6, times=times - 10**13, **fault)
    assert 'degraded: joint_1b excluded' in usual.states
    assert early.result.state == usual.result.state
    np.testing.assert_array_equal(early.result.bounds, usual.result.bounds)


def test_the_progress_is_reported_every_so_many_samples(monkeypatch):
    monkeypatch.setattr(recording, 'PROGRESS_SAMPLES', 25)
    reported = []
    values = complete(SUPERVISION_SETTINGS, {})
    recording.run(TIMES, READINGS, values, reported.append)
    assert reported == [0, 25, 50]


@pytest.mark.parametrize(('most', 'published'), [(3.0, 0), (4.0, 26), (5.0, 26), (6.0, 54)])
def test_a_run_stops_once_more_samples_are_withheld_than_allowed(most, published):
    """Four at the start, and two missing readings."""
    readings = READINGS.copy()
    readings[30:32, 2] = np.nan
    values = complete(SUPERVISION_SETTINGS, {})
    found = recording.run(TIMES, readings, values, most_withheld=most)
    assert found.published.sum() == published
