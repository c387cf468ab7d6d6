# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The banner: what is, in words, and no old pose that looks alive."""

import pytest
from spm_haptic_master.parameters.nodes import DIAGNOSTICS_SETTINGS
from spm_haptic_master.supervision.orientation_state import received_state
from spm_haptic_master.view.liveness import banner, Light, STALE_AFTER


@pytest.mark.parametrize(('state', 'age', 'light', 'text', 'alive'), [
    ('', None, Light.GREY, 'waiting for fkm', False),
    ('starting', None, Light.GREY, 'starting', False),
    ('starting', 0.0, Light.AMBER, 'starting', False),
    ('', 0.0, Light.AMBER, 'state unknown: fkm publishes it', False),
    ('healthy', 0.0, Light.GREEN, 'healthy', True),
    ('healthy', STALE_AFTER, Light.GREEN, 'healthy', True),
    # The state is that of the orientations: they go out, and something else is missing.
    ('healthy', 0.3, Light.RED, 'no joint_states for 0.25 s (diagnostics)', False),
    ('healthy', 1.0, Light.RED, 'no joint_states for 1 s (diagnostics)', False),
    ('healthy', None, Light.AMBER, 'healthy, but no joint_states (diagnostics)', False),
    ('starting', 7.2, Light.RED, 'silent: no orientation for 7 s', False),
    ('', 0.3, Light.RED, 'silent: no orientation for 0.25 s', False),
    ('degraded: joint_1b', 0.1, Light.AMBER, 'degraded: joint_1b', True),
    ('degraded: joint_1b', 0.4, Light.RED, 'no joint_states for 0.25 s (diagnostics)', False),
    # The reason of a silence is on the page at once, whatever was drawn last.
    ('silent: no joint samples', 0.0, Light.RED, 'silent: no joint samples', False),
    ('silent: joint_3a stuck', None, Light.RED, 'silent: joint_3a stuck', False),
    # Words of another program vouch for nothing.
    ('healthy again', 0.0, Light.RED, "silent: unknown state 'healthy again'", False),
    ('degraded', None, Light.RED, "silent: unknown state 'degraded'", False)])
def test_the_banner_says_what_is_and_no_old_pose_is_alive(state, age, light, text, alive):
    shown = banner(received_state(state) if state else None, age)
    assert (shown.light, shown.text, shown.alive) == (light, text, alive)


def test_the_banner_is_in_time_and_no_rate_looks_like_a_silence():
    """Grey within half a second, with two ticks; at the lowest rate one pose may be missing."""
    (rate,) = [each for each in DIAGNOSTICS_SETTINGS if each.name == 'joint_states_rate']
    assert 2.5 / rate.minimum <= STALE_AFTER < 0.3
