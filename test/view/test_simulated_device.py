# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All that a user of the page can operate: faults, sliders and stories of a simulated device."""

from math import cos, degrees, nan, pi, radians, sin

from geometry_msgs.msg import QuaternionStamped
from mechanism import SINGULAR_PHI
import numpy as np
import pytest
from spm_haptic_master.kinematics import dexterity, quaternion_from_matrix, workspace_pose
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.steering import PHI_LIMITS
from spm_haptic_master.view.names import SENSOR_NAMES, with_sensor_names
from spm_haptic_master.view.stories import Observations, stories, verdict


def test_the_knobs_are_those_of_a_simulated_device_alone(shown):
    shown.begin(source='can: can0')
    controls = shown.server.gui._gui_input_handle_from_uuid
    assert not controls
    shown.say('source', 'sim')
    assert controls
    stop = shown.control('move by itself')._impl.update_cb
    shown.say('source', 'can: can0')
    assert not controls
    shown.published.clear()
    stop[0](None)
    assert not shown.published


def add_fault(shown, kind, joint, offset):
    """Press the button of a fault; return what it publishes, and show it as the faults there."""
    shown.control('encoder')._impl.value = with_sensor_names(joint)
    shown.control('offset, deg')._impl.value = offset
    ((topic, faults),) = shown.operate('fault', kind)
    assert topic == FAULT_TOPIC
    shown.say(FAULTS_TOPIC, faults)
    return faults


def test_faults_add_up_and_another_offset_of_a_joint_replaces_the_one_before(shown):
    shown.begin(source='sim')
    for kind, joint, offset, expected in (
        ('offset', 'joint_1b', 5.0, 'offset:joint_1b=5'),
        ('stuck', 'joint_1b', 5.0, 'offset:joint_1b=5, stuck:joint_1b'),
        ('offset', 'joint_3a', 5.0, 'offset:joint_1b=5, stuck:joint_1b, offset:joint_3a=5'),
        ('offset', 'joint_1b', 1.0, 'stuck:joint_1b, offset:joint_3a=5, offset:joint_1b=1'),
        ('stuck', 'joint_1b', 1.0, 'offset:joint_3a=5, offset:joint_1b=1, stuck:joint_1b'),
    ):
        assert add_fault(shown, kind, joint, offset) == expected
        words = f'faults: {with_sensor_names(expected)}<'
        assert words in shown.arm.simulation._faults_html.content
    shown.run(0.3, shown.pose)
    assert shown.content['sample']['happened'][:2] == [
        'faults: offset:th1B=5',
        'faults: offset:th1B=5, stuck:th1B',
    ]
    assert shown.operate('no fault') == [(FAULT_TOPIC, '')]


def test_a_fault_ends_a_story(shown):
    shown.begin(source='sim')
    shown.operate('cross the singularity')
    shown.run(0.3, shown.pose)
    add_fault(shown, 'stuck', 'joint_1b', 5.0)
    shown.run(0.3, shown.pose)
    assert shown.note not in [step.words for step in stories(4)[0].steps]


def test_there_are_as_many_encoders_to_choose_as_the_device_has(shown):
    """The faults that there are stay shown."""
    shown.begin(source='sim')
    faults = add_fault(shown, 'stuck', 'joint_1b', 5.0)
    shown.parameters = {'sensors': 6}
    shown.run(6.0)
    assert list(shown.control('encoder').options) == list(SENSOR_NAMES)
    words = f'faults: {with_sensor_names(faults)}<'
    assert words in shown.arm.simulation._faults_html.content


SLIDERS = ('tilt, deg', 'azimuth, deg', 'self-rotation, deg')


def sliders(shown, *degrees):
    """Let the device be at a pose for a while; return where the sliders are."""
    shown.run(0.5, lambda: shown.pose(*np.radians(degrees)))
    return [shown.control(label).value for label in SLIDERS]


def test_the_sliders_follow_the_device_until_a_user_moves_one(shown):
    shown.begin(source='sim')
    assert sliders(shown, 10.0, 40.0, 30.3) == [10.0, 40.0, 30.5]
    assert not shown.published
    ((topic, pose),) = shown.operate('tilt, deg', 9.0)
    assert topic == STEER_TOPIC
    assert pose == pytest.approx(np.radians([9.0, 40.0, 30.5]))
    assert sliders(shown, 5.0, -40.0, 20.0) == [9.0, 40.0, 30.5]
    assert shown.operate('move by itself') == [(STEER_TOPIC, [])]
    assert sliders(shown, 25.0, -40.0, 20.0) == [20.0, -40.0, 20.0]


def test_a_slider_that_is_moved_ends_a_story(shown):
    shown.begin(source='sim')
    shown.run(0.5, shown.pose)
    shown.operate('cross the singularity')
    shown.operate('tilt, deg', 9.0)
    shown.run(0.5, shown.pose)
    assert shown.note not in [step.words for step in stories(4)[0].steps]


def test_another_source_ends_the_lead_and_its_sliders_are_new_ones(shown):
    shown.begin(source='sim')
    shown.run(0.5, shown.pose)
    shown.operate('tilt, deg', 9.0)
    for source in ('can: can0', 'sim'):
        shown.say('source', source)
    assert sliders(shown, 6.0, 40.0, 30.0) == [6.0, 40.0, 30.0]


# Between two looks at a story, s.
TICK = 0.25


def messages_of(step):
    """Return what a step of a story publishes."""
    sent = []
    if step.faults is not None:
        sent.append((FAULT_TOPIC, step.faults))
    if step.phi is not None:
        sent.append((STEER_TOPIC, [0.0, 0.0, radians(step.phi)]))
    return sent


@pytest.mark.parametrize(
    ('sensors', 'number'),
    [
        (4, 0),
        (4, 1),
        (4, 2),
        (6, 1),
        (6, 2),
    ],
)
def test_a_story_does_its_steps_each_with_its_sentence_and_ends_with_a_verdict(
    shown,
    sensors,
    number,
):
    """In place of another one that is played, and without a fault."""
    shown.begin(source='sim', sensors=sensors)
    story = stories(sensors)[number]
    shown.operate(stories(sensors)[number - 1].name)
    shown.run(TICK, shown.pose, TICK)
    shown.operate(story.name)
    ends = [step.at for step in story.steps[1:]] + [story.end]
    for index, (step, end) in enumerate(zip(story.steps, ends, strict=True), start=1):
        shown.run(TICK, shown.pose, TICK)
        assert shown.published == messages_of(step)
        shown.published.clear()
        shown.run(end - step.at - TICK, shown.pose, TICK)
        assert not shown.published
        assert shown.note == step.words
        progress = shown.content['note']['story']
        assert progress['step'] == index
        assert progress['steps'] == len(story.steps) + 1
    shown.run(TICK, shown.pose, TICK)
    assert shown.published == [(STEER_TOPIC, [])]
    last = shown.content['note']
    assert last['story']['step'] == last['story']['steps']
    assert last['text'] in shown.content['sample']['happened']
    shown.run(13.0, shown.pose, TICK)
    assert shown.content['note']['story'] is None


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_the_faults_of_a_story_are_ones_and_are_gone_at_its_end(sensors):
    for story in stories(sensors):
        faults = [step.faults for step in story.steps if step.faults is not None]
        for words in faults[:-1]:
            assert not words or parse_switched(words, sensors)
        assert faults[-1] == ''


def test_the_verdict_has_the_largest_errors_that_were_seen():
    cross, frozen, _ = stories(4)
    seen = Observations()
    for alive, three, device in (
        (True, nan, nan),
        (True, radians(14.1), radians(0.04)),
        (True, radians(2.0), nan),
    ):
        seen.add(0.05, alive, three, device)
    assert verdict(cross, 4, seen) == (
        'Three encoders: up to 14.1\u00b0 wrong. The four of the device: 0.0\u00b0.'
    )
    assert (
        verdict(frozen, 4, seen)
        == 'The device never fell silent, and was at most 0.0\u00b0 wrong.'
    )
    seen.add(3.0, False, nan, nan)
    assert 'silent for 3 s: a slave stops' in verdict(frozen, 4, seen)
    # An error that nobody measured is not said to be small.
    assert 'an unknown angle' in verdict(cross, 4, Observations())


def test_the_error_of_the_device_is_that_to_the_simulations_truth(shown):
    """Turned by 2 deg from what is published, while a story is played."""
    shown.begin(source='sim')
    shown.operate('cross the singularity')
    turn = np.array(
        [
            [cos(radians(2.0)), -sin(radians(2.0)), 0.0],
            [sin(radians(2.0)), cos(radians(2.0)), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )

    def truth_and_pose():
        R = shown.pose(0.1, 0.3, 0.5)
        message = QuaternionStamped()
        x, y, z, w = quaternion_from_matrix(R @ turn)
        message.quaternion.x = x
        message.quaternion.y = y
        message.quaternion.z = z
        message.quaternion.w = w
        message.header.stamp.sec = shown._samples
        shown.newest['/ground_truth/orientation'] = message

    shown.run(1.0, truth_and_pose)
    assert '/ground_truth/orientation' in shown.sampled
    assert degrees(shown.arm.simulation.player.observed.device) == pytest.approx(2.0, abs=1e-6)
    shown.operate('move by itself')
    shown.run(0.1, shown.pose)
    assert '/ground_truth/orientation' not in shown.sampled


def test_the_azimuth_stands_still_where_there_is_no_tilt(shown):
    shown.begin(source='sim')
    shown.run(0.5, lambda: shown.pose(radians(10.0), radians(40.0), 0.5))
    rng = np.random.default_rng(3)
    shown.run(3.0, lambda: shown.pose(radians(0.5), rng.uniform(-pi, pi), 0.5))
    assert shown.control('azimuth, deg').value == 40.0
    assert shown.control('tilt, deg').value == 0.5


def test_a_story_leads_to_the_singularity_and_across_it():
    """It begins and ends clear of it, and is near it on its other side in between."""
    cross, broken, _ = stories(4)
    clear, singular, near, beyond, *back = phis = [step.phi for step in cross.steps]
    etas = dexterity(workspace_pose(0.0, 0.0, np.radians(phis)))
    assert singular == pytest.approx(degrees(SINGULAR_PHI), abs=0.05)
    assert clear < singular < near < beyond
    assert back[-1] == clear
    assert etas[1] < 0.001
    assert 0.05 < etas[2] < 0.1
    assert min(etas[0], *etas[3:]) > 0.1
    assert [step.phi for step in broken.steps] == [singular, None, clear, None]


def test_the_poses_of_a_story_are_within_those_that_a_user_can_give():
    lowest, highest = np.degrees(PHI_LIMITS)
    for step in stories(4)[0].steps:
        assert lowest < step.phi < highest


@pytest.mark.parametrize(('sensors', 'is_silent'), [(4, True), (6, False)])
def test_with_four_encoders_a_device_is_silent_without_one_of_them(sensors, is_silent):
    for story in stories(sensors)[1:]:
        words = ' '.join(step.words for step in story.steps)
        assert ('silent' in words) is is_silent


def test_each_step_of_a_story_leaves_time_to_read_it():
    for story in stories(4):
        times = [step.at for step in story.steps] + [story.end]
        pauses = np.diff(times)
        assert times[0] == 0.0
        assert pauses.min() > 1.9
        assert pauses.max() < 8.0
