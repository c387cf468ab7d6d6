# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All that a user of the page can operate: faults, sliders and stories of a simulated device."""

from math import degrees, radians

from mechanism import SINGULAR_PHI
import numpy as np
import pytest
from spm_haptic_master.kinematics import dexterity, workspace_pose
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.steering import PHI_LIMITS
from spm_haptic_master.view.simulated_device import stories


def test_the_knobs_are_those_of_a_simulated_device_alone(shown):
    """Faults end a story and add up; another offset of a joint replaces the one before."""
    shown.begin(source='can: can0')
    assert not shown.server.gui._gui_input_handle_from_uuid
    shown.say('source', 'sim')
    shown.operate('cross the singularity')
    for kind, joint, offset, expected in (
        ('offset', 'joint_1b', 5.0, 'offset:joint_1b=5'),
        ('stuck', 'joint_1b', 5.0, 'offset:joint_1b=5, stuck:joint_1b'),
        ('offset', 'joint_3a', 5.0, 'offset:joint_1b=5, stuck:joint_1b, offset:joint_3a=5'),
        ('offset', 'joint_1b', 1.0, 'stuck:joint_1b, offset:joint_3a=5, offset:joint_1b=1'),
        ('stuck', 'joint_1b', 1.0, 'offset:joint_3a=5, offset:joint_1b=1, stuck:joint_1b'),
    ):
        shown.control('encoder')._impl.value = joint
        shown.control('offset, deg')._impl.value = offset
        assert shown.operate('fault', kind) == [(FAULT_TOPIC, expected)]
        shown.say(FAULTS_TOPIC, expected)
        assert f'faults: {expected}<' in shown.arm.simulation._faults_html.content
    shown.run(0.3, shown.pose)
    assert shown.content['note'] != stories(4)[0].words
    assert shown.content['sample']['happened'][:2] == [
        'faults: offset:joint_1b=5',
        'faults: offset:joint_1b=5, stuck:joint_1b',
    ]
    assert shown.operate('no fault') == [(FAULT_TOPIC, '')]
    # As many encoders as there are; none without a simulation.
    shown.parameters = {'sensors': 6}
    shown.run(6.0)
    assert list(shown.control('encoder').options) == list(ALL_JOINT_NAMES)
    assert f'faults: {expected}<' in shown.arm.simulation._faults_html.content
    stop = shown.control('move by itself')._impl.update_cb
    shown.say('source', 'can: can0')
    assert not shown.server.gui._gui_input_handle_from_uuid
    shown.published.clear()
    stop[0](None)
    assert not shown.published


def test_the_sliders_follow_the_device_until_a_user_moves_one(shown):
    shown.begin(source='sim')
    labels = 'tilt, deg', 'azimuth, deg', 'self-rotation, deg'

    def sliders(*degrees):
        shown.run(0.5, lambda: shown.pose(*np.radians(degrees)))
        return [shown.control(label).value for label in labels]

    assert sliders(10.0, 40.0, 30.3) == [10.0, 40.0, 30.5]
    assert not shown.published
    shown.operate('cross the singularity')
    ((topic, pose),) = shown.operate(labels[0], 9.0)
    assert topic == STEER_TOPIC and pose == pytest.approx(np.radians([9.0, 40.0, 30.5]))
    shown.run(0.5, shown.pose)
    assert shown.content['note'] != stories(4)[0].words
    assert sliders(5.0, -40.0, 20.0) == [9.0, 40.0, 30.5]
    assert shown.operate('move by itself') == [(STEER_TOPIC, [])]
    assert sliders(25.0, -40.0, 20.0) == [20.0, -40.0, 20.0]
    # Another source ends the lead; its knobs are new ones.
    shown.operate(labels[0], 9.0)
    for source in ('can: can0', 'sim'):
        shown.say('source', source)
    assert sliders(6.0, 40.0, 30.0) == [6.0, 40.0, 30.0]


@pytest.mark.parametrize(('sensors', 'number'), [(4, 0), (4, 1), (4, 2), (6, 2)])
def test_a_story_does_its_steps_is_explained_and_ends_without_a_fault(shown, sensors, number):
    """In place of another one that is played."""
    shown.begin(source='sim', sensors=sensors)
    story, period = stories(sensors)[number], 0.25
    shown.operate(stories(sensors)[number - 1].name)
    shown.run(period, shown.pose, period)
    shown.operate(story.name)
    times = [step.at for step in story.steps]
    for step, pause in zip(story.steps, np.diff(times, append=times[-1] + 1.0), strict=True):
        shown.run(period, shown.pose, period)
        ends = step is story.steps[-1]
        sent = [(STEER_TOPIC, [])] if ends else []
        if step.phi is not None:
            sent.append((STEER_TOPIC, [0.0, 0.0, radians(step.phi)]))
        if step.faults is not None:
            sent.insert(0, (FAULT_TOPIC, step.faults))
            assert not step.faults or parse_switched(step.faults, sensors)
        assert shown.published == sent
        shown.published.clear()
        shown.run(pause - period, shown.pose, period)
        assert not shown.published and (shown.content['note'] == story.words) != ends
    assert [step.faults for step in story.steps if step.faults is not None][-1] == ''


def test_the_stories_lead_to_the_singularity_and_across_it():
    ((cross, broken, unplugged),) = {stories(4)}
    phis = [step.phi for step in cross.steps[:-1]]
    assert degrees(SINGULAR_PHI) == pytest.approx(phis[1], abs=0.05)
    etas = [float(dexterity(workspace_pose(0.0, 0.0, radians(phi)))) for phi in phis]
    # It begins and ends clear of it, and is near it on its other side in between.
    assert etas[1] < 0.001 and min(etas[0], *etas[3:]) > 0.1 > etas[2] > 0.05
    assert phis[0] == phis[-1] < phis[1] < phis[2] < phis[3]
    assert [step.phi for step in broken.steps] == [phis[1], None, phis[0], None, None]
    assert PHI_LIMITS[0] < radians(min(phis)) and radians(max(phis)) < PHI_LIMITS[1]
    # With four encoders a device is silent without one of them.
    assert [['silent' in each.words for each in stories(sensors)[1:]] for sensors in (4, 6)] == [
        [True, True],
        [False, False],
    ]
    for story in (cross, broken, unplugged):
        times = [step.at for step in story.steps]
        assert times[0] == 0.0 and all(1.9 < each < 8.0 for each in np.diff(times))
