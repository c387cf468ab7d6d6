# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a calibration is good for: refused, for a region, or no longer; never a silent fkm."""

from dataclasses import replace
from math import radians
import re

import numpy as np
import pytest
from recorded_text import assert_recorded
from rig_as_built import calibration, mechanism
from spm_haptic_master.calibration.motion.coverage import region_of, WORKSPACE
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.tools import calibration_verdict as verdict
from spm_haptic_master.tools.calibrate import main


@pytest.fixture
def found(calibrated):
    """Return the calibration of the motion."""
    return calibrated[2].calibration


@pytest.fixture
def fkm(calibrated, monkeypatch):
    """Return a function that gives the parameters of fkm with a calibration."""
    monkeypatch.setattr(verdict, 'SECONDS', 10.0)
    return lambda **given: verdict.FkmValues(given, calibrated[2].origin)


def test_a_limit_is_supported_from_the_least_one_on(found, fkm):
    least = verdict.least_alert_limit(found, fkm())
    assert 1.0 < least < 30.0
    assert least in verdict.ALERT_LIMITS_DEG
    assert [*verdict.ALERT_LIMITS_DEG] == sorted(set(verdict.ALERT_LIMITS_DEG))
    with pytest.raises(CalibrationError) as caught:
        verdict.supported(found, fkm())
    # It begins with what to do, and names the limit that is accepted.
    assert re.match(
        r'the motion does not support alert_limit_deg 1: .* divides the predicted error by '
        r'\d\.\d \(.*\); record only what is missing, and join both by --motion FIRST.log '
        r'SECOND.log; a task that tolerates more may take -p '
        rf'alert_limit_deg:={least:g} \(bias_deg over the',
        str(caught.value),
    )
    assert verdict.supported(found, fkm(alert_limit_deg=least)) == (found, least)
    below = verdict.ALERT_LIMITS_DEG[verdict.ALERT_LIMITS_DEG.index(least) - 1]
    with pytest.raises(CalibrationError):
        verdict.supported(found, fkm(alert_limit_deg=below))
    # A limit of its own is tried too.
    own = 0.5 * (below + least)
    assert verdict.least_alert_limit(found, fkm(alert_limit_deg=own)) in (own, least)


def test_a_refusal_names_three_cures_and_the_best_of_them_first(found):
    larger, longer, smaller = found.cures
    assert larger.startswith('a larger motion (t')
    assert longer == 'a motion twice as long'
    assert '--mechanism-tolerance' in smaller
    assert 1.0 < found.cures[longer] <= np.sqrt(2.0)
    text = verdict.cure_text(found)
    best = max(found.cures, key=lambda cure: found.cures[cure])
    assert text.startswith(f'{best} divides the predicted error by {found.cures[best]:.1f} (')
    # Where the drawing alone determines the parameters, nothing but its tolerances helps.
    zeros_alone = np.diag(np.where(np.arange(found.layout.count) < 4, 1e12, 1e-3))
    known = replace(found, information=zeros_alone, advice_gain=1.0)
    assert verdict.cure_text(known).startswith('half of --mechanism-tolerance and --harm')


def test_a_sensor_that_is_checked_nowhere_is_named_and_start_checked_refused(found, fkm):
    stamps = np.arange(100) * 10_000_000
    large = replace(found, covariance=found.covariance * 16.0)
    checked = verdict.checked_region(large, fkm(alert_limit_deg=1.0), stamps)
    assert min(checked.share) == 0.0
    assert checked.least_limit_deg > 1.0
    assert re.match(
        'with alert_limit_deg 1 nothing checks .*joint_3a anywhere in the region: with '
        'start_checked .* fkm publishes nothing; alert_limit_deg '
        rf'{checked.least_limit_deg:.2f} is the smallest',
        checked.caution,
    )
    with pytest.raises(CalibrationError, match='^start_checked is true, but with alert_limit'):
        verdict.checked_region(large, fkm(alert_limit_deg=1.0, start_checked=True), stamps)
    good = replace(found, covariance=found.covariance * 0.01)
    found_checked = verdict.checked_region(good, fkm(start_checked=True), stamps)
    assert not found_checked.caution
    assert min(found_checked.share) > 0.3
    assert len(found_checked.lines) == 4


def test_a_motion_that_determines_too_little_names_no_limit(found, fkm):
    nothing = replace(found, covariance=found.covariance * 50.0)
    assert nothing.region_error > radians(0.5)
    small = replace(nothing, rotation=found.rotation[:1].repeat(len(found.rotation), axis=0))
    for each, words in ((nothing, 'is no better'), (small, 'is too small')):
        with pytest.raises(CalibrationError, match=f'the region moved, .*, {words}') as caught:
            verdict.supported(each, fkm(alert_limit_deg=30.0))
        assert 'a task that tolerates more' not in str(caught.value)


def test_starts_after_gaps_of_the_recording_say_nothing_against_a_calibration(found, fkm):
    """As on a machine that is too busy for its bus: a start withholds 4 samples."""
    stamps = (found.readings.seconds * 1e9).astype(np.int64)
    readings = found.readings.readings
    whole = replace(found, readings=replace(found.readings, spiked=np.zeros(len(stamps), bool)))
    with_gaps = stamps + np.arange(len(stamps)) // 50 * 2_000_000_000
    values = fkm(alert_limit_deg=30.0)
    share = verdict.published_share(
        whole,
        (with_gaps, readings),
        values,
        lambda *_: None,
    )
    assert share == 1.0


def test_the_motion_is_published_but_for_the_start_and_a_slip_is_refused(found, fkm):
    values = fkm(alert_limit_deg=30.0)
    stamps = (found.readings.seconds * 1e9).astype(np.int64)
    readings = found.readings.readings
    whole = replace(found, readings=replace(found.readings, spiked=np.zeros(len(stamps), bool)))
    shown = []
    assert (
        verdict.published_share(
            whole,
            (stamps, readings),
            values,
            lambda *each: shown.append(each),
        )
        == 1.0
    )
    assert {text for text, _ in shown} == {'supervision of the motion'}
    assert all(0.0 <= share <= 1.0 for _, share in shown)
    slipped = readings.copy()
    slipped[len(slipped) // 2 :, 1] += radians(8.0)
    with pytest.raises(
        CalibrationError,
        match=r'fkm publishes \d\d\.\d % of the motion, expected '
        r'99 % at least: (?!starting|settling).*\(\d+ samples?\); nothing is',
    ):
        verdict.published_share(
            whole,
            (stamps, slipped),
            values,
            lambda *_: None,
        )
    # Without the sets that have a spike.
    spiked = replace(found.readings, spiked=np.arange(len(stamps)) >= len(stamps) // 2)
    assert (
        verdict.published_share(
            replace(found, readings=spiked),
            (stamps, slipped),
            values,
            lambda *_: None,
        )
        > 0.99
    )


def test_the_angles_are_those_of_the_driver_by_the_file(found, fkm):
    """Of the model that was fitted, but for the rounding of the file."""
    np.testing.assert_allclose(
        fkm().angles(found, found.readings.readings),
        found.model.corrected(found.turned, found.vector),
        atol=2e-6,
    )


def test_a_part_of_the_workspace_is_for_its_region_only(found, fkm):
    """Where less than half of the largest tilt and of the turn has been moved."""
    rotation = found.rotation.copy()
    tilt = np.arccos(np.clip(rotation[:, :, 2].sum(axis=1) / np.sqrt(3.0), -1.0, 1.0))
    rotation[tilt > radians(11.0)] = np.nan
    moved = replace(found, rotation=rotation)
    region = region_of(rotation)
    least = verdict.least_alert_limit(replace(moved, region=region), fkm())
    assert least < verdict.least_alert_limit(found, fkm())
    part, limit = verdict.supported(moved, fkm(alert_limit_deg=least))
    assert (part.region, limit) == (region, least)
    assert region != WORKSPACE
    assert part.region_error < found.region_error
    assert (part.bias <= found.bias).all()


def write(path, **changes):
    """Write the rig's calibration, without the second harmonics, that no model knows."""
    values = (
        calibration()
        | mechanism()
        | {'sigma_deg': [0.0405] * 4, 'bias_deg': [0.07] * 4}
        | {name.replace('__', '.'): value for name, value in changes.items()}
    )
    path.write_text(
        '/**:\n  ros__parameters:\n'
        + ''.join(
            f'    {name}: {value}\n'.replace('True', 'true')
            for name, value in values.items()
            if value is not None
        )
    )
    return path


@pytest.fixture(scope='module')
def another_motion(motion_log):
    """Return the arguments of another motion of the rig."""
    return motion_log('dev_check')


@pytest.fixture
def check(
    another_motion,
    capsys,
    tmp_path,
):
    """Return what checks a calibration with changes; it returns exit code, stdout and stderr."""

    def check(*args, **changes):
        path = write(tmp_path / 'c.yaml', **changes)
        code = main(['calibrate', '--motion', '--check', str(path), *(args or another_motion)])
        out, err = (each.replace(f'{tmp_path}/', '') for each in capsys.readouterr())
        assert [each.name for each in tmp_path.iterdir()] == ['c.yaml']
        return code, out, err

    return check


def test_a_calibration_holds_until_a_zero_slips_or_a_direction_is_another(check):
    code, out, err = check()
    assert code == 0
    assert_recorded('calibration/check_printed.txt', out)
    zero, direction = (
        [*calibration()[f'encoders.{name}']] for name in ('zero_count', 'direction')
    )
    # Counts that are 0.22 deg.
    zero[3] += 10
    code, out, err = check(encoders__zero_count=zero)
    assert code == 1
    assert 'c.yaml: does not hold; 1951 sets' in out
    slip = re.fullmatch(
        r'calibrate: c.yaml does not hold: joint_3a slipped by ([-+.\d]+) deg '
        r'\(\+- 0.0\d\)',
        err.splitlines()[-1],
    )
    assert float(slip[1]) == pytest.approx(-direction[3] * 0.22, abs=0.04)
    direction[2] *= -1
    code, out, err = check(encoders__direction=direction)
    assert code == 1
    assert (
        err.splitlines()[-1]
        == 'calibrate: c.yaml does not hold: joint_1c turns in the opposite direction'
    )
    assert re.search(r'\n  only \d+ % of the angles fit the mechanism\n', out)


@pytest.mark.parametrize(
    ('args', 'changes', 'words'),
    [
        (
            (),
            {'sigma_deg': None},
            'c.yaml: it has no sigma_deg; expected a file that calibrate wrote',
        ),
        (('--check', '/none.yaml'), {}, '/none.yaml: cannot be read: '),
        (('-o', 'out.yaml'), {}, '-o out.yaml with --check .*; expected one of them'),
        (
            ('--seconds', '1'),
            {},
            r'100 sets of four encoders in 1\.0 s; a motion needs at least 200',
        ),
    ],
)
def test_no_calibration_or_no_motion_is_refused_in_one_line(
    check,
    another_motion,
    args,
    changes,
    words,
):
    code, out, err = check(*another_motion, *args, **changes)
    assert (code, out) == (1, '') and re.match(f'calibrate: .*{words}', err), err
    assert err.count('\n') == 1
