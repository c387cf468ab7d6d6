# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device on the page: what is drawn of its topics, and when it no longer is."""

from functools import partial
import json
from math import radians

from diagnostic_msgs.msg import DiagnosticStatus
from mechanism import SINGULAR_PHI
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from shown_device import TICK, turn_of
from spm_haptic_master.kinematics import dexterity, workspace_pose
from spm_haptic_master.kinematics.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.view.arm import DEVICE_ALONE
from spm_haptic_master.view.dome import RADIUS
from spm_haptic_master.view.status import Light
from std_msgs.msg import Float64MultiArray

# Time after which all of the picture is there (s).
WHOLE = DEVICE_ALONE + 1.0


def test_what_is_shown_is_the_pose_all_the_way_through_the_singularity(shown):
    """By other formulas: platform, trace, map, figures, and three encoders alone."""
    shown.begin()
    shown.run(WHOLE, shown.pose)
    rng = np.random.default_rng(5)
    errors = []
    seen = []
    ghost = shown.scene.ghost.platform
    for phi in np.arange(SINGULAR_PHI - 0.2, SINGULAR_PHI + 0.25, 0.004):
        pose = 0.0005, 3.0 * phi, phi
        R = workspace_pose(*pose)
        eta = float(dexterity(R)), float(dexterity(R, sensors=4))
        shown.newest['/dexterity'] = Float64MultiArray(data=eta)
        angles = shown.readings(pose, radians(0.04) * rng.standard_normal(4))
        shown.run(TICK, partial(shown.pose, *pose))
        np.testing.assert_allclose(turn_of(shown.scene._turned), R, atol=1e-6)
        errors.append((eta[0], shown.content['sample']['values']['ghost'][0]))
        seen.append(ghost.visible)
    # Three encoders alone are drawn where they are wrong, and not where nothing is.
    assert any(seen)
    assert not seen[0]
    assert not seen[-1]
    assert ghost.name.startswith(f'{shown.scene._turned.name}/')
    shown.run(1.0, partial(shown.pose, *pose))
    np.testing.assert_allclose(shown.scene.dome.pin.position, RADIUS * R[:, 2], atol=1e-6)
    np.testing.assert_allclose(
        shown.content['sample']['values']['angles'],
        np.degrees(angles),
        atol=1e-6,
    )
    dome = shown.scene.dome
    np.testing.assert_allclose(dome.tiles.batched_colors, dome._map.colours(phi), atol=1.0)
    # Noise alone clear of the singularity, and more at it.
    near, clear = (
        [error for three, error in errors if low < three < high]
        for low, high in ((0.0, 0.02), (0.12, 1.0))
    )
    assert len(clear) > 3
    assert max(near) > 1.0 > 2.0 * np.nanmax(clear)
    # Three encoders are solved with their own dexterity.
    taken = []
    shown.arm._ghost.solve = taken.append
    shown.run(TICK)
    assert taken == [eta[0]]
    # A dexterity of another number is none.
    shown.newest['/dexterity'] = Float64MultiArray(data=[0.1])
    shown.run(1.0, shown.pose)
    assert shown.rows['dexterity of 3'] == shown.rows['three encoders'] == '\u2013'


def test_another_mechanism_or_mounting_of_fkm_is_drawn_within_a_second(shown):
    """Though its state was healthy before and is healthy now."""
    shown.begin()
    before = shown.scene
    shown.run(5.0, shown.fkm)
    assert len(shown.asked) == 5
    assert shown.scene is before
    shown.parameters = {'mounting.base_zxz_deg': [0.0, 90.0, 0.0]}
    shown.run(1.1, shown.fkm)
    assert shown.scene is not before
    assert before._fixed._impl.removed
    assert before._floor._impl.removed
    np.testing.assert_allclose(
        turn_of(shown.scene._fixed),
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
        atol=1e-6,
    )
    # A mechanism that cannot be assembled changes nothing.
    mounted = shown.scene
    shown.parameters = {'geometry.alpha_deg': 80.0, 'geometry.beta_deg': 20.0}
    shown.run(2.0, shown.fkm)
    assert shown.scene is mounted
    # One that reaches little is drawn where any can be assembled: upright, at the centre.
    shown.parameters = {
        'geometry.alpha_deg': 20.0,
        'geometry.beta_deg': 20.0,
        'geometry.gamma_deg': 90.0,
    }
    shown.run(1.1)
    assert shown.scene is not mounted
    centre = workspace_pose(0.0, 0.0, 0.0)
    np.testing.assert_allclose(turn_of(shown.scene._turned), centre, atol=1e-6)
    np.testing.assert_allclose(turn_of(shown.scene._fixed), centre.T, atol=1e-6)


def test_the_reason_of_a_missing_picture_is_on_the_page(shown):
    """Orientations go out, but diagnostics does not publish joint_states of them."""
    shown.begin()
    fkm = 'fkm: orientation'
    text = 'diagnostics: singularity'
    shown.run(
        1.0,
        lambda: (
            shown.fkm()
            or shown.entry(text, 'near a singularity of the sensors in use', DiagnosticStatus.WARN)
        ),
    )
    assert shown.text == 'healthy'
    # A message from before is no reason.
    shown.run(0.4, lambda: shown.entry(fkm))
    assert shown.text == 'no joint_states for 0.25 s (diagnostics)'
    shown.run(
        4.0,
        lambda: (
            shown.entry(fkm)
            or shown.entry(text, 'outside the working mode', DiagnosticStatus.ERROR)
        ),
    )
    assert shown.text == 'no joint_states for 4 s (diagnostics: outside the working mode)'
    # Without any news the state is an old one.
    shown.run(3.0)
    assert shown.text == 'silent: nothing from fkm, no joint_states for 7 s'


def test_a_repeated_or_unreadable_pose_is_not_drawn(shown):
    """An old value does not keep the picture alive, nor does another robot's or a silent one."""
    shown.begin()
    shown.run(1.0, shown.pose)
    drawn = shown.scene._turned.wxyz
    shown.run(1.2, lambda: shown.pose(0.3, again=True))
    assert shown.text == 'no joint_states for 1 s (diagnostics)'
    for name, position in (
        (['joint_1'] * 9, [0.0] * 9),
        (list(MECHANISM_JOINT_NAMES), [np.nan] * 9),
    ):
        shown.takers['/joint_states'](JointState(name=name, position=position))
        shown.run(TICK)
        assert not shown.arm.seen.banner.alive
    shown.say('state', 'silent: no joint samples')
    shown.run(0.5, lambda: shown.pose(0.3))
    np.testing.assert_array_equal(shown.scene._turned.wxyz, drawn)


@pytest.mark.parametrize('ends', ['silence', 'nobody looks'])
def test_no_way_is_drawn_that_nobody_has_seen(shown, ends):
    """In the trace, when the device or the page comes back."""
    shown.begin()
    place = iter(np.arange(0.0, 1.0, 0.002))
    shown.run(2.0, lambda: shown.pose(0.3, next(place)))
    shown.watched = ends == 'silence'
    shown.run(3.0, lambda: shown.watched or shown.pose(0.3, 2.0))
    shown.watched = True
    place = iter(np.arange(3.1, 4.0, 0.002))
    shown.run(3.0, lambda: shown.pose(0.3, next(place)))
    line = shown.scene.dome.trace.points
    assert len(line) > 10
    assert 0.004 <= np.linalg.norm(line[:, 1] - line[:, 0], axis=-1).max() < 0.02


def test_the_cone_of_the_protection_level(shown):
    """Ten times as wide as it is, and never wider than a cone on the dome is legible."""
    cone = shown.begin().scene.level
    for level, half_angle in (('0.5', 5.0), ('3.0', 20.05)):
        shown.run(WHOLE, partial(shown.fkm, **{'protection level (deg)': level}))
        assert cone.visible
        assert np.degrees(np.arctan(cone.scale)) == pytest.approx(
            [half_angle, half_angle, 45.0], abs=0.01
        )
    shown.run(0.4, partial(shown.fkm, **{'protection level (deg)': 'none'}))
    assert not cone.visible


def test_the_device_comes_before_what_is_beside_it(shown):
    """Before anybody sees the device, that time does not begin."""
    arm = shown.begin().arm
    scene = arm._scene
    arm._scene = None
    # Nor does it before the mechanism is known: there is no orientation either.
    shown.parameters = None
    shown.run(WHOLE, shown.fkm)
    assert shown.rows['orientation'] == '\u2013'
    arm._scene = scene
    for watched, seconds in ((False, WHOLE), (True, 1.0), (False, WHOLE)):
        shown.watched = watched
        shown.run(seconds, shown.fkm)
    shown.watched = True
    shown.run(WHOLE - 1.5, shown.fkm)
    assert arm.seen.banner.alive
    assert not any(frame.visible for frame in (scene._fixed_rest, scene._turned_rest))
    shown.run(1.5, shown.fkm)
    assert all(frame.visible for frame in (scene._fixed_rest, scene._turned_rest))
    assert scene.dome.singular.visible
    # It stays for a mechanism that is drawn anew.
    shown.parameters = {'geometry.beta_deg': 34.0}
    shown.run(3.0, shown.fkm)
    assert shown.scene is not scene
    assert all(frame.visible for frame in (shown.scene._fixed_rest, shown.scene._turned_rest))


@pytest.mark.parametrize(('rate', 'least', 'most'), [(60.0, 57.0, 63.0), (500.0, 57.0, 84.0)])
def test_every_pose_at_60_hz_is_drawn_and_no_faster_than_is_seen(
    shown,
    rate,
    least,
    most,
):
    shown.begin()
    shown.run(2.0, shown.pose, period=1.0 / rate)
    assert least <= int(shown.rows['picture'].split()[0]) <= most
    shown.run(1.0)
    assert shown.rows['picture'] == '0 poses a second'


def test_the_arrows_of_torques_and_the_state_of_the_force_feedback(shown):
    """By their topics; arrows end when torques do."""
    arrows = shown.begin().scene.torques

    def torque(**sizes):
        shown.torques(**sizes)
        shown.pose()

    shown.run(TICK, lambda: torque(servo=0.2, measured=0.2))
    for arrow in arrows:
        # Along y, three units for 1 N m.
        tip = turn_of(arrow) @ [0.0, 0.0, arrow.scale[2]]
        np.testing.assert_allclose(tip, [0.0, 0.6, 0.0], atol=1e-6)
    assert shown.sampled == {'/dexterity', '/readings', '/body/servo_cf', '/body/measured_cf'}
    # What is too small to be seen has no arrow, and what no longer comes.
    shown.run(TICK, lambda: torque(servo=0.001, measured=0.006))
    assert [arrow.visible for arrow in arrows] == [False, True]
    shown.run(0.4, lambda: torque(servo=0.2))
    assert [arrow.visible for arrow in arrows] == [True, False]
    # Words of another program are no state of the force feedback.
    for words, figure in (('fading: no hand on the handle',) * 2, ('strong', '\u2013')):
        shown.say('force_state', words)
        shown.run(0.5, shown.pose)
        assert shown.rows['force'] == figure
    # What nobody looks at is not subscribed to.
    shown.watched = False
    shown.run(TICK)
    assert not shown.sampled


def test_a_calibration_is_shown_until_it_ends(shown):
    """A killed program leaves no last word; words of another program are none."""
    shown.begin()

    def says(text):
        shown.say(COVERAGE_TOPIC, text)
        shown.run(0.5)
        return shown.content['calibration']

    found = {'text': 'turn it', 'covered': {'tilt': 0.89, 'turn': 0.9}}
    expected = {
        'text': 'turn it',
        'covered': [('tilt', 0.89, Light.AMBER.colour), ('turn', 0.9, Light.GREEN.colour)],
    }
    assert says(json.dumps(found)) == says('[1]') == says('turn') == expected
    assert says('{}') is None
    assert says(json.dumps(found)) == expected
    shown.calibrates = False
    shown.run(0.5)
    assert shown.content['calibration'] is None
