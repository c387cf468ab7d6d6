# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Engaging, clutch and losses of a slave that pivots about a trocar."""

from engaging_rig import Rig
import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import matrix_from_quaternion

TROCAR = (0.1, -0.05, 0.2)
# Shaft in the tool's frame, as the manufacturer has it.
SHAFT = np.array([0.6, 0.0, 0.8])
# Period of the samples (ms), and the time after which an insertion is missing: 3 periods + 10 ms.
MISSING = 13


def pivoting(depth=0.1, **parameters):
    """Return the rig of a slave whose tip is at a depth (m) below its trocar."""
    rig = Rig(**{'trocar': list(TROCAR), **parameters})
    place(rig, depth)
    rig.insertion = 0.02
    return rig


def place(rig, depth):
    """Put the slave's tip at a depth (m), in its present direction."""
    rig.tip = tuple(np.array(TROCAR) + depth * rig.slave @ SHAFT)


def distance(rig):
    """Return the largest distance of the trocar from the shafts of the last commands, m."""
    rotation = matrix_from_quaternion(rig.last.pose.rotation)
    return np.linalg.norm(np.cross(np.array(TROCAR) - rig.last.pose.position, rotation @ SHAFT))


def slide(rig, speed, steps):
    """Slide the handle at a speed, m/s, for some ms, and turn it."""
    for _ in range(steps):
        rig.insertion += speed * 0.001
        rig.run(1, (0.3, -0.2, 0.1))
        assert distance(rig) <= 1e-12


def depth_of(tip):
    return np.linalg.norm(np.array(tip) - TROCAR)


def test_insertion_and_tilt_move_the_tip_about_the_trocar_without_a_step():
    rig = pivoting(insertion_scale=0.5).engage()
    np.testing.assert_allclose(rig.tips[0], rig.tip, atol=1e-12)
    slide(rig, 0.1, 400)
    assert depth_of(rig.tips[-1]) == pytest.approx(0.1 + 0.5 * 0.04, abs=3e-4)
    depths = list(map(depth_of, rig.tips))
    # Never faster than half of the hand, from one command to the next.
    assert max(np.diff(depths)) <= 0.5 * 0.1 * 0.005 * 1.5
    assert rig.state == 'engaged'


def test_the_clutch_takes_depth_and_insertion_anew():
    rig = pivoting(command_rate=0.0).engage()
    slide(rig, 0.1, 200)
    held = rig.last.pose
    rig.machine.take_clutch(True)
    rig.slave = matrix_from_quaternion(held.rotation)
    rig.tip = held.position
    rig.insertion -= 0.05
    assert rig.run(100, (0.5, 0.0, 0.0)) == []
    rig.machine.take_clutch(False)
    first = len(rig.tips)
    rig.run(5)
    np.testing.assert_allclose(rig.tips[first], held.position, atol=1e-12)
    slide(rig, 0.1, 200)
    assert depth_of(rig.tips[-1]) == pytest.approx(0.1 + 0.04, abs=1e-3)


@pytest.mark.parametrize('clutched', [False, True])
def test_a_lost_insertion_disengages_within_three_periods_and_10_ms(clutched):
    rig = pivoting(command_rate=0.0).engage()
    rig.machine.take_clutch(clutched)
    rig.run(20)
    rig.insertion = None
    assert len(rig.run(MISSING)) == (0 if clutched else MISSING)
    assert rig.state in ('engaged', 'clutched')
    assert rig.run(2) == []
    assert rig.state == 'disengaged: insertion missing'
    # It comes back: nothing engages by itself.
    rig.insertion = 0.02
    assert rig.run(100) == []
    assert rig.state.startswith('disengaged: waiting for enable, after: insertion missing') or (
        rig.state == 'disengaged: clutch pressed'
    )


def test_what_came_while_the_process_stood_still_is_no_loss():
    rig = pivoting().engage()
    rig.machine.pass_time(0.04)
    rig.machine.take_insertion(rig.insertion)
    rig.run(1)
    assert rig.state == 'engaged'


def follow(rig, aside=0.0):
    """Put the slave where it is commanded, its tip some m aside of it."""
    rig.slave = matrix_from_quaternion(rig.last.pose.rotation)
    across = np.cross(rig.slave @ SHAFT, (0.0, 1.0, 0.0))
    rig.tip = tuple(np.array(rig.last.pose.position) + aside * across / np.linalg.norm(across))


def test_a_shaft_that_leaves_its_trocar_while_it_follows_disengages():
    rig = pivoting().engage()
    for aside in (0.0, 0.004):
        follow(rig, aside)
        rig.run(10)
        assert rig.state == 'engaged'
    follow(rig, 0.012)
    assert rig.run(10) == []
    assert rig.state == (
        'disengaged: waiting for enable, after: shaft 12 mm off the trocar, expected 5 mm or less'
    )


def test_a_shaft_beside_its_trocar_goes_no_deeper_than_its_tolerance():
    """The command's line is that from the trocar to the tip; the tool's axis is another one."""
    # Of the tool's frame, 2.3 deg off the line: 4 mm at a depth of 0.1 m.
    axis = SHAFT + 0.04 * np.array([0.0, 1.0, 0.0])
    rig = pivoting(shaft_axis=(axis / np.linalg.norm(axis)).tolist()).engage()
    for _ in range(100):
        rig.insertion += 0.001
        rig.run(10)
        follow(rig)
        if not rig.state == 'engaged':
            break
    assert rig.state.startswith('disengaged: waiting for enable, after: shaft 5 mm off the trocar')
    assert depth_of(rig.tips[-1]) < 0.13


def test_a_tip_that_does_not_follow_disengages():
    """As with a jammed slide: once it is free, the tip would jump."""
    rig = pivoting(tip_tracking_limit=0.02).engage()
    rig.insertion += 0.019
    rig.run(500)
    assert rig.state == 'engaged'
    rig.insertion += 0.01
    rig.run(500)
    assert rig.state == ('disengaged: waiting for enable, after: tip 21 mm from its command')


def test_without_trocar_no_insertion_is_needed_and_the_tip_stays():
    rig = pivoting(trocar=[0.0])
    rig.insertion = None
    rig.engage()
    rig.run(50, (0.0, 0.0, 0.5))
    np.testing.assert_allclose(rig.tips, [rig.tip] * len(rig.tips), atol=1e-15)


def test_a_slave_that_needs_its_trocar_does_not_follow_without():
    rig = pivoting(trocar=[0.0], requires_trocar=True).ready()
    assert rig.state == 'disengaged: no trocar'
    assert rig.machine.enable() == 'no trocar'
    rig.machine.take_trocar(TROCAR)
    rig.engage()


@pytest.mark.parametrize(('moved', 'ends'), [(0.0015, False), (0.003, True)])
@pytest.mark.parametrize('clutched', [False, True])
def test_a_trocar_that_moves_ends_it(moved, ends, clutched):
    rig = pivoting().engage()
    rig.machine.take_clutch(clutched)
    # In small steps it is no less far.
    for part in (0.5, 1.0):
        rig.machine.take_trocar((TROCAR[0] + part * moved, *TROCAR[1:]))
    rig.run(10)
    expected = 'disengaged: waiting for enable, after: trocar moved by 3 mm'
    if clutched and ends:
        expected = 'disengaged: clutch pressed'
        assert rig.machine.last_disengage_reason == 'trocar moved by 3 mm'
    elif not ends:
        expected = 'clutched' if clutched else 'engaged'
    assert rig.state.replace(' no presence', ' waiting for enable') == expected


def test_a_trocar_that_comes_while_the_tip_stays_ends_it():
    rig = pivoting(trocar=[0.0]).engage()
    rig.machine.take_trocar(TROCAR)
    assert rig.machine.last_disengage_reason == 'a trocar was given'
    assert rig.run(50) == []


@pytest.mark.parametrize(
    ('parameters', 'depth', 'aside', 'why'),
    [
        ({}, 0.003, 0.0, 'tip at the trocar: 3 mm, expected 5 mm or more'),
        ({}, 0.35, 0.0, 'depth 350 mm, expected 10 to 300 mm'),
        (
            {'shaft_axis': SHAFT.tolist()},
            0.1,
            0.012,
            'shaft 12 mm off the trocar, expected 5 mm or less',
        ),
    ],
)
def test_engaging_is_refused_with_the_distance(parameters, depth, aside, why):
    rig = pivoting(depth, **parameters)
    rig.tip = tuple(np.array(rig.tip) + aside * rig.slave @ [0.0, 1.0, 0.0])
    rig.ready()
    rig.machine.take_presence(True)
    assert rig.machine.enable() == ''
    assert rig.run(60) == []
    assert rig.state == f'disengaged: {why}'
    # The slave is moved to where it can pivot, while the enable still holds.
    place(rig, 0.1)
    assert rig.run(100)
    assert rig.state == 'engaged'


def test_a_shaft_that_was_pushed_aside_during_the_clutch_ends_it():
    rig = pivoting().engage()
    rig.machine.take_clutch(True)
    rig.run(10)
    rig.tip = tuple(np.array(rig.tip) + 0.008 * rig.slave @ [0.0, 1.0, 0.0])
    rig.run(100)
    rig.machine.take_clutch(False)
    assert rig.run(100) == []
    assert rig.machine.last_disengage_reason == 'shaft 8 mm off the trocar, expected 5 mm or less'


def test_a_shaft_that_is_pushed_aside_by_several_clutches_is_that_of_engaging():
    """In small steps it is no less far: the shaft stays where it is in the tool."""
    rig = pivoting().engage()
    for pushed in (1, 2):
        rig.machine.take_clutch(True)
        follow(rig)
        rig.tip = tuple(np.array(rig.tip) + 0.004 * rig.slave @ [0.0, 1.0, 0.0])
        rig.run(100)
        rig.machine.take_clutch(False)
        given = rig.run(100)
        assert bool(given) is (pushed == 1)
    assert rig.machine.last_disengage_reason == 'shaft 8 mm off the trocar, expected 5 mm or less'


def test_a_shaft_that_was_pushed_aside_stays_watched_as_it_goes_deeper():
    """4 mm at a depth of 0.1 m are 6 mm at 0.15 m."""
    rig = pivoting().engage()
    rig.machine.take_clutch(True)
    rig.tip = tuple(np.array(rig.tip) + 0.004 * rig.slave @ [0.0, 1.0, 0.0])
    rig.run(100)
    rig.machine.take_clutch(False)
    for _ in range(50):
        rig.insertion += 0.001
        rig.run(10)
        rig.slave = matrix_from_quaternion(rig.last.pose.rotation)
        rig.tip = rig.last.pose.position
    assert rig.machine.last_disengage_reason.startswith('shaft 5 mm off the trocar')
    assert depth_of(rig.tips[-1]) < 0.13


def test_the_tilt_counts_from_engaging_and_not_from_the_clutch():
    rig = pivoting(tilt_limit_deg=20.0).engage()
    axis = rig.slave @ SHAFT
    across = np.cross(axis, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    for _ in range(3):
        rig.run(400, across)
        rig.machine.take_clutch(True)
        rig.slave = matrix_from_quaternion(rig.last.pose.rotation)
        rig.tip = rig.last.pose.position
        rig.run(100)
        rig.machine.take_clutch(False)
        rig.run(100)
    tilt = np.degrees(np.arccos(axis @ rig.commands[-1][1] @ SHAFT))
    assert tilt == pytest.approx(20.0, abs=1e-6)


@pytest.mark.parametrize(('moved', 'engages'), [(0.0009, True), (0.0011, False)])
def test_a_tip_that_has_moved_by_a_millimetre_is_not_at_rest(moved, engages):
    rig = pivoting(command_rate=0.0).ready()
    rig.machine.take_presence(True)
    place(rig, 0.1 + moved)
    rig.machine.enable()
    assert bool(rig.run(1)) is engages


def test_a_depth_that_does_not_follow_needs_no_insertion():
    rig = pivoting(insertion_scale=0.0)
    rig.insertion = None
    rig.engage()
    assert rig.run(50, (0.3, 0.0, 0.0))
    assert depth_of(rig.tips[-1]) == pytest.approx(0.1)


def test_an_engaging_anew_takes_the_shaft_anew():
    """It is the clutch alone that keeps it."""
    rig = pivoting().engage()
    rig.machine.disengage()
    rig.tip = tuple(np.array(rig.tip) + 0.008 * rig.slave @ [0.0, 1.0, 0.0])
    rig.run(100)
    assert rig.machine.enable() == ''
    assert rig.run(20)
    np.testing.assert_allclose(rig.last.pose.position, rig.tip, atol=1e-12)


def test_a_slave_that_slides_is_not_at_rest():
    rig = pivoting().ready()
    rig.machine.take_presence(True)
    for depth in np.arange(0.1, 0.13, 0.0002):
        place(rig, depth)
        assert rig.run(1) == []
        rig.machine.enable()
    assert rig.state == 'disengaged: waiting for the slave to be at rest'


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('insertion_scale', 0.01),
        ('depth_range', [0.2, 0.1]),
        ('trocar', [0.1, 0.2]),
        ('shaft_axis', [0.0, 0.0, 0.5]),
    ],
)
def test_settings_that_contradict_are_refused(name, value):
    with pytest.raises(SettingError, match=f'teleop.{name}'):
        Rig(**{name: value})


def test_the_depth_is_known_only_with_a_trocar_and_the_slaves_pose():
    rig = pivoting()
    assert rig.machine.depth is None
    rig.run(20)
    assert rig.machine.depth == pytest.approx(0.1)
    without_trocar = Rig()
    without_trocar.run(20)
    assert without_trocar.machine.depth is None
