# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The state of a device and of its encoders in words, and no old pose that looks alive."""

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from shown_device import entries_of
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.orientation_state import received_state
from spm_haptic_master.view import status
from spm_haptic_master.view.status import Light, sensor_states, SensorState
from spm_haptic_master.view.status_entries import StatusEntries

DRIVER = {'encoder_driver: encoders': (DiagnosticStatus.OK, 'publishing', {})}


@pytest.mark.parametrize(
    ('state', 'age', 'light', 'text', 'alive'),
    [
        ('', None, Light.GREY, 'waiting for fkm', False),
        ('starting', None, Light.GREY, 'starting', False),
        ('starting', 0.0, Light.AMBER, 'starting', False),
        ('', 0.0, Light.AMBER, 'state unknown: fkm publishes it', False),
        ('healthy', 0.0, Light.GREEN, 'healthy', True),
        ('healthy', status.STALE_AFTER, Light.GREEN, 'healthy', True),
        # The state is that of the orientations: they go out, and something else is missing.
        ('healthy', 0.3, Light.RED, 'no joint_states for 0.25 s (diagnostics)', False),
        ('healthy', None, Light.AMBER, 'healthy, but no joint_states (start diagnostics)', False),
        ('starting', 1.0, Light.RED, 'silent: no orientation for 1 s', False),
        ('degraded: joint_1b missing', 0.1, Light.AMBER, 'degraded: th1B missing', True),
        # The reason of a silence is on the page at once, whatever was drawn last.
        ('silent: no joint samples', 0.0, Light.RED, 'silent: no joint samples', False),
        # Words of another program vouch for nothing.
        ('healthy again', 0.0, Light.RED, "silent: unknown state 'healthy again'", False),
    ],
)
def test_the_banner_says_what_is_and_no_old_pose_is_alive(
    state,
    age,
    light,
    text,
    alive,
):
    shown = status.banner(received_state(state) if state else None, age)
    assert (shown.light, shown.text, shown.alive) == (light, text, alive)


def test_a_silence_is_as_long_as_it_is_but_for_a_pause_of_this_process():
    """After one, its first tick comes before what has come meanwhile is read."""
    age = status.SampleAge()
    age.renew(0.02)
    age.tick(0.05)
    assert age.value == 0.0
    # Slow ticks, with joint angles between any two; then none come.
    for now in (0.5, 1.0):
        age.renew(now - 0.01)
        age.tick(now)
        assert age.value == pytest.approx(0.01)
    age.tick(1.5)
    assert age.value == pytest.approx(0.51)
    # Ticks in time; then a pause, of which the next tick knows how long it was.
    for now, expected in ((1.55, 0.56), (1.6, 0.02), (2.6, 0.02), (2.65, 1.07)):
        if now == 1.6:
            age.renew(1.58)
        age.tick(now)
        assert age.value == pytest.approx(expected)


@pytest.mark.parametrize(
    ('state', 'driver', 'expected'),
    [
        ('healthy', DRIVER, {}),
        ('degraded: joint_3b excluded', DRIVER, {'joint_3b': SensorState.EXCLUDED}),
        ('silent: joint_1c stuck', DRIVER, {'joint_1c': SensorState.EXCLUDED}),
        (
            'degraded: joint_3c missing',
            {
                'encoder_driver: encoders': (
                    DiagnosticStatus.WARN,
                    'joint_3c: no answer',
                    {'joints missing': 'joint_3c'},
                )
            },
            {'joint_3c': SensorState.MISSING},
        ),
        # Before the driver has said so, the state alone names it: it is not faulty.
        ('degraded: joint_3c missing', DRIVER, {'joint_3c': SensorState.MISSING}),
        (
            'degraded: joint_3b missing, joint_1a excluded',
            DRIVER,
            {'joint_3b': SensorState.MISSING, 'joint_1a': SensorState.EXCLUDED},
        ),
        ('silent: joint_1b: no answer', DRIVER, {'joint_1b': SensorState.MISSING}),
        # With four there is no set without one of them: the driver's words name it.
        (
            'silent: no joint samples',
            {'encoder_driver: encoders': (DiagnosticStatus.ERROR, 'joint_1b: no answer', {})},
            {'joint_1b': SensorState.MISSING},
        ),
    ],
)
def test_the_state_of_each_sensor(
    state,
    driver,
    expected,
):
    figures = {f'{name} unchecked (s)': '1.0' for name in ALL_JOINT_NAMES}
    figures['joint_3a unchecked (s)'] = 'inf'
    entries = entries_of(driver | {'fkm: orientation': (DiagnosticStatus.OK, 'healthy', figures)})
    assert (
        dict(zip(ALL_JOINT_NAMES, sensor_states(entries, 6, received_state(state)), strict=True))
        == dict.fromkeys(ALL_JOINT_NAMES, SensorState.HEALTHY)
        | {'joint_3a': SensorState.UNCHECKED}
        | expected
    )
    # What no longer comes is not known.
    entries.now = 10.0
    assert sensor_states(entries, 4, None) == [SensorState.UNKNOWN] * 4


@pytest.mark.parametrize(
    ('name', 'now', 'seen'),
    [
        ('left/fkm: orientation', 3.5, True),
        ('left/fkm: orientation', 3.6, False),
        ('fkm: orientation', 1.0, False),
        ('right/fkm: orientation', 1.0, False),
        ('left/a/fkm: orientation', 1.0, False),
    ],
)
def test_an_entry_is_of_its_own_device_and_of_now(
    name,
    now,
    seen,
):
    entries = StatusEntries('/left')
    entries.add(DiagnosticStatus(name=name), 1.0)
    entries.now = now
    assert (entries.entry('fkm: orientation') is not None) is seen
    assert entries.has_ended('fkm: orientation') is (now > 3.5)


def test_an_encoder_without_a_number_in_the_readings_has_no_reading():
    """Though its driver has not said so yet, and the state names it."""
    entries = entries_of(DRIVER)
    state = received_state('silent: joint_1b stuck')
    assert sensor_states(entries, 4, state, ['joint_1b'])[1] is SensorState.MISSING


@pytest.mark.parametrize(
    ('age', 'heard', 'event'),
    [
        (1.0, False, 'silent: nothing from fkm, no joint_states'),
        (1.0, True, 'no joint_states (diagnostics)'),
    ],
)
def test_the_event_of_a_silence_does_not_change_with_its_length(
    age,
    heard,
    event,
):
    banners = [
        status.banner(received_state('healthy'), age * k, heard=heard) for k in (1, 2, 3600)
    ]
    assert len({banner.text for banner in banners}) == 3
    assert {banner.event for banner in banners} == {event}
