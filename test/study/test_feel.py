# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session to feel: what is rendered in it, and how fast each loss ends the torque."""

import numpy as np
import pytest

pytest.importorskip('matplotlib')
pytest.importorskip('mujoco')

from spm_haptic_master.force import ForceLimits  # noqa: E402, I100
from study.force import feel  # noqa: E402
from study.force.crossing import exact_share, thrown  # noqa: E402
from study.force.feel_picture import end_stop_deg  # noqa: E402
from study.force.session import CLUTCH, ENCODER, END_STOP, LOSSES, play  # noqa: E402


@pytest.fixture(scope='module')
def session():
    return play()


@pytest.mark.slow
@pytest.mark.parametrize('loss', LOSSES, ids=lambda loss: loss.name)
def test_each_loss_ends_a_torque_in_time(session, loss):
    assert np.abs(session.motor_torque[round(loss.time * 1000) - 1]).max() > 0.05
    assert session.time_to_zero(loss) <= loss.limit + 1e-9


@pytest.mark.slow
def test_what_a_session_goes_through(session):
    words = [
        text
        for before, text in zip(['', *session.states], session.states, strict=False)
        if text != before
    ]
    assert words == [
        'off',
        'ready',
        'engaged',
        'holding',
        'engaged',
        'fading: wrench missing or too old',
        'ready',
        'engaged',
        'fading: no orientation',
        'fault: no orientation',
        'off',
        'ready',
        'engaged',
        'fading: fault of a drive',
        'fault: fault of a drive',
        'off',
        'ready',
        'engaged',
        'fading: wrench missing or too old',
        'ready',
        'engaged',
    ]
    assert np.abs(session.motor_torque).max() <= 0.5
    wall = (session.time > 2.0) & (session.time < 2.3)
    np.testing.assert_allclose(session.rendered[wall], session.commanded[wall], atol=0.02)
    held = (session.time > CLUTCH[0] + 0.1) & (session.time < CLUTCH[1])
    assert np.abs(session.rendered[held]).max() < 0.02
    # No motor is turned up by an encoder that jumps.
    first = round(ENCODER[0] * 1000)
    torque = np.abs(session.motor_torque[first - 1 : first + 100])
    assert (torque[1:].max(axis=0) <= torque[0] + 0.01).all()


@pytest.mark.slow
def test_the_end_stop_pushes_back_without_a_wrench(session):
    """In `ready`: beyond its begin, and nothing before it."""
    during = (session.time > END_STOP[0] + 0.2) & (session.time < END_STOP[1] - 0.2)
    assert {text for text, is_in in zip(session.states, during, strict=True) if is_in} == {'ready'}
    felt = session.felt[during]
    angle = session.angle[during]
    assert felt.max() > 0.05
    assert angle.max() > end_stop_deg() + 10.0
    assert felt[angle < end_stop_deg() - 2.0].max() < 1e-3


@pytest.mark.slow
def test_a_relaxed_hand_is_thrown_across_less_than_by_the_fade_alone():
    """0.3 N m, hands of 1 and 3 N m/rad: 5.5 and 1.24 rad/s by the fade alone."""
    assert exact_share(ForceLimits()) >= 0.75
    assert thrown(1.0) <= 3.5
    assert thrown(3.0) <= 1.0


def test_feel_has_a_help(capsys):
    with pytest.raises(SystemExit) as ended:
        feel.main(['--help'])
    assert ended.value.code == 0
    assert '--output' in capsys.readouterr().out
