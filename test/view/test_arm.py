# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device on the page: what is drawn of its topics, and when it no longer is."""

import re
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    mechanism_angles,
    workspace_pose,
)
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, MECHANISM_JOINT_NAMES
from spm_haptic_master.parameters.geometry import mechanism_checksum
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.steering import PHI_LIMITS
from spm_haptic_master.view.status import SensorState
from std_msgs.msg import Float64MultiArray, String

pytest.importorskip('viser', reason='viser is not installed (extra view)')
arm_module = pytest.importorskip('spm_haptic_master.view.arm')
status_module = pytest.importorskip('spm_haptic_master.view.status')
page_module = pytest.importorskip('spm_haptic_master.view.page')
stories = pytest.importorskip('spm_haptic_master.view.simulated_device').stories
RADIUS = pytest.importorskip('spm_haptic_master.view.scene').RADIUS

PATIENCE = 20.0
# Time between two ticks, and between two joint angles (s).
TICK = 0.05
# Time after which all of the picture is there (s).
WHOLE = arm_module.DEVICE_ALONE + 1.0


class Shown:
    """An Arm on a real page that somebody looks at, on a clock of the test."""

    def __init__(self, observer, server):
        self.now = 1000.0
        self.observer, self.server = observer, server
        # Whether somebody looks at the page.
        self.watched = True
        self.happened = []
        self._samples = 0

    def begin(self, state='healthy', taker=None, **values):
        """Make the arm, with the mechanism of some settings already drawn, in a state."""
        node = self.observer.node
        self.arm = arm_module.Arm(node, taker or node, page_module.Page(self.server), '/', 0)
        self.arm._query.take(complete(status_module.SETTINGS, values))
        self.state(state)
        return self

    def state(self, text):
        self.arm._on_state(String(data=text))

    def pose(self, tilt=0.1, azimuth=0.0, phi=0.6):
        """Have new joint angles of a pose."""
        self._samples += 1
        message = JointState(name=list(MECHANISM_JOINT_NAMES), position=mechanism_angles(
            tuple(workspace_pose(tilt, azimuth, phi).ravel().tolist()), Geometry()))
        message.header.stamp.sec = self._samples
        self.arm._on_joints(message)

    def entry(self, name, message='', level=DiagnosticStatus.OK, **values):
        """Have an entry on /diagnostics."""
        self.arm.on_diagnostics(DiagnosticStatus(
            level=level, name=name, message=message, values=[
                KeyValue(key=key, value=value) for key, value in values.items()]))

    def fkm(self, **values):
        """Have a pose and an entry of a healthy fkm."""
        self.pose()
        self.entry('fkm: orientation', 'healthy', **{'protection level (deg)': '0.5', **values})

    def run(self, seconds, each=lambda: None, period=TICK):
        """Let time pass, with something before each tick."""
        for _ in range(round(seconds / period)):
            self.now += period
            each()
            self.arm.tick(self.now)
            if self.content:
                self.happened += self.content['sample']['happened']

    @property
    def scene(self):
        return self.arm._scene

    @property
    def knobs(self):
        """Return the knobs of the device, which is simulated."""
        if self.arm.simulation.knobs is None:
            self.arm._on_source(String(data='sim'))
        return self.arm.simulation

    @property
    def text(self):
        return self.arm.seen.banner.text

    @property
    def content(self):
        """Return what the page has of the device; empty before it has anything."""
        return self.arm._page.content.get('', {})

    @property
    def rows(self):
        """Return the figures by the names of their rows."""
        return {name: text for name, text, *_ in self.content.get('rows', ())}

    def beside(self):
        """Return what of the page is beside the device and its state."""
        scene = self.scene
        return [scene.dome.tiles, scene.dome.singular, scene.dome.rim, scene.dome.trace,
                scene.dome.pin, scene.level, *scene.labels]


@pytest.fixture
def shown(observer, serve, monkeypatch):
    """Give a Shown that has not begun."""
    server = serve()
    server.gui.reset()
    server.scene.reset()
    made = Shown(observer, server)
    monkeypatch.setattr(arm_module, 'time', SimpleNamespace(monotonic=lambda: made.now))
    monkeypatch.setattr(server, 'get_clients', lambda: {0: None} if made.watched else {})
    return made


@pytest.fixture
def another_fkm(observer, shown):
    """Make a node `fkm` with some settings and show a device that has the default ones."""
    node = Node('fkm', context=observer.context)

    def make(**given):
        observer._executor.add_node(node)
        for name, value in complete(status_module.SETTINGS, given).items():
            node.declare_parameter(name, list(value) if isinstance(value, tuple) else value)
        assert observer.spin_until(shown.begin().arm._query._client.service_is_ready, PATIENCE)
        return shown.arm._query, shown.scene

    yield make
    node.destroy_node()


def test_another_mechanism_of_a_restarted_fkm_is_asked_for(shown, observer, another_fkm,
                                                           monkeypatch):
    """By its checksum: its state was healthy before and is healthy now."""
    given = {'geometry.beta_deg': 36.0}
    query, before = another_fkm(**given)
    # The answer that has been, and no question for its own sake.
    monkeypatch.setattr(status_module, 'ASK_PERIOD', 1e9)
    query._asked_at, query._answered = 0.0, True
    same, other = (mechanism_checksum(complete(status_module.SETTINGS, each))
                   for each in ({}, given))
    shown.run(2.0, lambda: shown.fkm(mechanism=same))
    assert query._asked_at == 0.0
    assert observer.spin_until(lambda: shown.run(TICK, lambda: shown.fkm(mechanism=other))
                               or shown.scene is not before, PATIENCE)


@pytest.mark.parametrize('given', [{}, {'mounting.base_zxz_deg': [0.0, 90.0, 0.0]}])
def test_fkm_is_asked_again_and_only_another_mounting_is_drawn_anew(shown, observer, another_fkm,
                                                                    monkeypatch, given):
    """The mounting is no part of the mechanism's checksum."""
    (query, before), asked = another_fkm(**given), []
    call = query._client.call_async
    monkeypatch.setattr(query._client, 'call_async',
                        lambda request: asked.append(shown.now) or call(request))
    assert observer.spin_until(lambda: shown.run(0.5, period=0.5) or (
        len(asked) >= 3 and query._answered), PATIENCE)
    assert (shown.scene is not before) == before._root._impl.removed == bool(given)
    assert np.diff(asked).min() >= status_module.ANSWER_TIMEOUT


def test_the_reason_of_a_missing_picture_is_on_the_page(shown):
    """Orientations go out, but diagnostics does not publish joint_states of them."""
    shown.begin()
    fkm, text = 'fkm: orientation', 'diagnostics: singularity'
    shown.run(1.0, lambda: shown.fkm() or shown.entry(text, 'near a singularity of the sensors in '
                                                      'use', DiagnosticStatus.WARN))
    assert shown.text == 'healthy' and shown.scene._alive
    # A message from before is no reason.
    shown.run(0.4, lambda: shown.entry(fkm))
    assert shown.text == 'no joint_states for 0.25 s (diagnostics)'
    shown.run(4.0, lambda: shown.entry(fkm) or shown.entry(
        text, 'outside the working mode', DiagnosticStatus.ERROR))
    assert shown.text == 'no joint_states for 4 s (diagnostics: outside the working mode)'
    assert not shown.scene._alive
    # Without any news the state is an old one.
    shown.run(3.0)
    assert shown.text == 'silent: nothing from fkm, no joint_states for 7 s'
    shown.state('silent: no joint samples')
    assert shown.text == 'silent: no joint samples'


def test_a_repeated_or_unreadable_pose_is_not_drawn(shown):
    """An old value does not keep the picture alive, nor does another robot's."""
    shown.begin()
    shown.run(1.0, shown.pose)
    shown.run(1.2, lambda: setattr(shown, '_samples', 19) or shown.pose())
    assert shown.text == 'no joint_states for 1 s (diagnostics)'
    for name, position in ((['joint_1'] * 9, [0.0] * 9),
                           (list(MECHANISM_JOINT_NAMES), [np.nan] * 9)):
        message = JointState(name=name, position=position)
        message.header.stamp.sec = 77
        shown.arm._on_joints(message)
        shown.run(TICK)
        assert not shown.arm.seen.banner.alive


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
    shown.run(2.0, lambda: shown.pose(0.3, next(place)))
    line = shown.scene.dome.trace.points
    assert len(line) > 10
    assert np.linalg.norm(line[:, 1] - line[:, 0], axis=-1).max() < 0.02


def test_another_offset_replaces_the_one_before(shown):
    """And nothing else: other faults stay, and one that is present is not there twice."""
    knobs, asked = shown.begin().knobs, []
    knobs._fail = asked.append
    for kind, joint, offset, expected in (
            ('offset', 'joint_1b', 5.0, 'offset:joint_1b=5'),
            ('stuck', 'joint_1b', 5.0, 'offset:joint_1b=5, stuck:joint_1b'),
            ('offset', 'joint_3a', 5.0, 'offset:joint_1b=5, stuck:joint_1b, offset:joint_3a=5'),
            ('offset', 'joint_1b', 1.0, 'stuck:joint_1b, offset:joint_3a=5, offset:joint_1b=1'),
            ('stuck', 'joint_1b', 1.0, 'offset:joint_3a=5, offset:joint_1b=1, stuck:joint_1b')):
        knobs.joint.value, knobs.offset.value = joint, offset
        knobs.add_fault(kind)
        assert asked[-1] == expected
        knobs._on_faults(String(data=expected))
        assert f'faults: {expected}<' in knobs._faults_html.content
    shown.run(0.5, shown.pose)
    assert shown.happened[:2] == ['faults: offset:joint_1b=5',
                                  'faults: offset:joint_1b=5, stuck:joint_1b']


def test_a_mechanism_that_reaches_little_is_drawn(shown):
    """At the centre it can be assembled, as any that is not refused; elsewhere it need not."""
    shown.begin(**{'geometry.alpha_deg': 20.0, 'geometry.beta_deg': 20.0,
                   'geometry.gamma_deg': 90.0})
    assert shown.scene is not None


@pytest.mark.parametrize(('level', 'half_angle'), [(0.5, 5.0), (3.0, 20.05)])
def test_the_cone_of_the_protection_level(shown, level, half_angle):
    """Ten times as wide as it is, and never wider than a cone on the dome is legible."""
    shown.begin()
    shown.run(WHOLE, lambda: shown.fkm(**{'protection level (deg)': str(level)}))
    cone = shown.scene.level
    assert cone.visible
    assert np.degrees(np.arctan(cone.scale[0])) == pytest.approx(half_angle, abs=0.01)
    shown.run(0.4, lambda: shown.fkm(**{'protection level (deg)': 'none'}))
    assert not cone.visible


def test_the_device_comes_before_what_is_beside_it(shown):
    """Before anybody sees the device, that time does not begin."""
    shown.begin()
    for watched, seconds in ((False, WHOLE), (True, 1.0), (False, WHOLE)):
        shown.watched = watched
        shown.run(seconds, shown.fkm)
    shown.watched = True
    scene, shown.arm._scene = shown.scene, None
    shown.run(WHOLE, shown.fkm)
    shown.arm._scene = scene
    shown.run(WHOLE - 1.5, shown.fkm)
    assert scene._alive and not any(each.visible for each in shown.beside())
    shown.run(1.5, shown.fkm)
    assert all(each.visible for each in shown.beside())
    # It stays for a mechanism that is drawn anew.
    shown.arm._build(complete(status_module.SETTINGS, {}))
    shown.run(1.0, shown.fkm)
    assert all(each.visible for each in shown.beside())


@pytest.mark.parametrize('after', [0.0, 1.0])
def test_the_map_of_a_silent_device_is_that_of_its_last_pose(shown, after):
    """Also where the silence comes before the map; without a pose, no point is shown."""
    scene = shown.begin().scene
    shown.run(after, lambda: shown.pose(phi=0.6))
    shown.state('silent: no joint samples')
    shown.run(WHOLE + TICK)
    assert scene.dome.tiles.visible
    if after:
        colours = scene.dome._map.colours(0.6)
        np.testing.assert_array_equal(scene.dome.tiles.batched_colors, colours)
        # Just outside the map.
        axes = scene.dome._map.singular_axes(0.6)
        np.testing.assert_allclose(scene.dome.singular.points, 1.01 * RADIUS * axes, rtol=0.009)
        assert len(axes) > 1
    assert scene.dome.singular.visible == scene.dome.pin.visible == bool(after)


@pytest.mark.parametrize(('rate', 'least', 'most'), [(60.0, 57.0, 63.0), (500.0, 57.0, 84.0)])
def test_every_pose_at_60_hz_is_drawn_and_no_faster_than_is_seen(shown, rate, least, most):
    shown.begin()
    rates = []

    def one_more():
        shown.pose()
        if shown.content:
            rates.append(float(re.match(r'\d+', shown.rows['picture'])[0]))

    shown.run(2.0, one_more, period=1.0 / rate)
    assert least <= np.mean(rates[len(rates) // 2:]) <= most
    shown.run(1.0)
    assert shown.rows['picture'] == '0 poses a second'


def test_the_figures_and_arrows_of_dexterity_and_torques(shown, observer):
    """By their topics; arrows end when torques do."""
    node, taker = observer.node, Node('taker', context=observer.context)
    dexterity = node.create_publisher(Float64MultiArray, 'dexterity', 1)
    outs = [node.create_publisher(WrenchStamped, f'body/{name}_cf', 1)
            for name in ('servo', 'measured')]
    arrows = shown.begin(taker=taker).scene.torques
    message = WrenchStamped()
    message.wrench.torque.x = 0.2

    def drawn():
        dexterity.publish(Float64MultiArray(data=[0.021, 0.4]))
        for out in outs:
            out.publish(message)
        shown.run(TICK, shown.fkm)
        return shown.rows.get('dexterity of 3') == '0.021' and all(
            arrow.visible for arrow in arrows)

    assert observer.spin_until(drawn, PATIENCE)
    assert shown.rows['dexterity of 4'] == '0.400'
    for arrow in arrows:
        # Along x, three units for 1 N m.
        tip = matrix_from_quaternion(np.roll(arrow.wxyz, -1)) @ [0.0, 0.0, arrow.scale[2]]
        np.testing.assert_allclose(tip, [0.6, 0.0, 0.0], atol=1e-6)
    # What is too small to be seen has no arrow.
    shown.arm._torques[1] = shown.now, (0.0, 0.001, 0.0)
    shown.run(TICK, shown.pose)
    assert [arrow.visible for arrow in arrows] == [True, False]
    shown.run(1.0, shown.pose)
    assert not any(arrow.visible for arrow in arrows)
    # Words of another program are no state of the force feedback.
    for words, figure in (('fading: no hand on the handle',) * 2, ('strong', '\u2013')):
        shown.arm._on_force(String(data=words))
        shown.run(0.5, shown.pose)
        assert shown.rows['force'] == figure
    # What nobody looks at is not subscribed to.
    shown.watched = False
    shown.run(TICK)
    assert observer.spin_until(lambda: not any(
        out.get_subscription_count() for out in (dexterity, *outs)), PATIENCE)
    taker.destroy_node()


def test_each_encoder_has_the_colour_of_its_state(shown):
    """In a silence, too: there it matters which one it is."""
    scene = shown.begin(sensors=6).scene
    figures = {f'{name} unchecked (s)': '0.0' for name in ALL_JOINT_NAMES}

    def expect(**states):
        found = [f'#{bytes(each.tolist()).hex()}' for handle in (scene._motors, scene._others)
                 for each in handle.batched_colors]
        assert found == [states.get(name, SensorState.HEALTHY).colour for name in ALL_JOINT_NAMES]

    shown.run(1.0, lambda: shown.fkm(**figures))
    expect()
    figures['joint_3a unchecked (s)'] = '4.0'
    shown.run(1.0, lambda: shown.fkm(**figures))
    expect(joint_3a=SensorState.UNCHECKED)
    shown.state('silent: joint_1b stuck')
    shown.run(1.0, lambda: shown.entry('fkm: orientation', 'silent', **figures))
    expect(joint_3a=SensorState.UNCHECKED, joint_1b=SensorState.EXCLUDED)
    assert not scene._alive
    assert list(dict.fromkeys(shown.happened)) == [
        'th3A not checked by the others', 'th1B faulty, excluded']


def test_the_ghost_is_over_a_device_that_is_alive(shown):
    scene = shown.begin().scene
    ghost, turn = scene.ghost, (0.0, 0.0, 0.1, 0.99 ** 0.5)

    def three():
        shown.fkm()
        shown.arm._ghost.turn = turn

    shown.run(1.0, three)
    assert not ghost.visible
    shown.run(WHOLE, three)
    assert ghost.visible
    np.testing.assert_allclose(ghost.wxyz, [0.99 ** 0.5, 0.0, 0.0, 0.1])
    # It is the platform's child: at no error it is the platform.
    assert ghost.name.startswith(f'{scene._frame.name}/')
    assert shown.rows['three encoders'] == '11.48\u00b0 off'
    shown.state('silent: no joint samples')
    shown.run(0.5)
    assert not ghost.visible


def test_the_sliders_follow_the_device_until_a_user_moves_one(shown):
    knobs, steered = shown.begin().knobs, []
    knobs._steer = lambda *pose: steered.append(pose)

    def sliders(*degrees):
        shown.run(1.0, lambda: shown.pose(*np.radians(degrees)))
        return [slider.value for slider in knobs.sliders]

    assert sliders(10.0, 40.0, 30.0) == [10.0, 40.0, 30.0]
    assert steered == []
    knobs._play(stories(4)[0], None)
    knobs._on_slider(SimpleNamespace(client=object()))
    assert steered == [pytest.approx(np.radians([10.0, 40.0, 30.0]))]
    assert knobs.tick(shown.now) == ''
    assert sliders(5.0, -40.0, 20.0) == [10.0, 40.0, 30.0]
    knobs._release(None)
    assert steered[1:] == [()]
    assert sliders(5.0, -40.0, 20.0) == [5.0, -40.0, 20.0]
    # Another source ends story and lead; its knobs are new ones.
    knobs._on_slider(SimpleNamespace(client=object()))
    knobs._play(stories(4)[0], None)
    for source in ('can: can0', 'sim'):
        shown.arm._on_source(String(data=source))
    assert knobs.tick(shown.now) == ''
    assert sliders(6.0, 40.0, 30.0) == [6.0, 40.0, 30.0]


@pytest.mark.parametrize(('sensors', 'number'), [(4, 0), (4, 1), (4, 2), (6, 2)])
def test_a_story_does_its_steps_is_explained_and_ends_without_a_fault(shown, sensors, number):
    knobs, story = shown.begin(sensors=sensors).knobs, stories(sensors)[number]
    period, done, expected = 0.2, [], []
    knobs._steer = lambda *pose: done.append((shown.now, pose))
    knobs._fail = lambda faults: done.append((shown.now, faults))
    # It takes the place of another one.
    knobs._play(stories(sensors)[number - 1], None)
    shown.run(0.2, shown.pose)
    done.clear()
    knobs._play(story, None)
    began = shown.now + period
    shown.run(1.0, shown.pose, period)
    assert shown.content['note'] == story.words
    shown.run(story.end, shown.pose, period)
    assert shown.content['note'] != story.words
    for at, phi, faults in story.steps:
        if faults is not None:
            expected.append((at, faults))
            assert not faults or parse_switched(faults, sensors)
        if phi is not None:
            expected.append((at, (0.0, 0.0, np.radians(phi))))
            assert PHI_LIMITS[0] <= np.radians(phi) <= PHI_LIMITS[1]
    expected.append((story.end, ()))
    (times, what), (due, asked) = (zip(*each, strict=True) for each in (done, expected))
    assert what == asked
    assert np.abs(np.subtract(times, due) - began).max() <= 1.1 * period
    assert [faults for faults in asked if isinstance(faults, str)][-1] == ''


def test_a_story_that_begins_as_another_one_ends_is_played(shown):
    """Its button is pressed in another thread than the ticks are in."""
    knobs, (one, other, _) = shown.begin().knobs, stories(4)
    knobs._steer = lambda *pose: pose or knobs._play(other, None)
    knobs._play(one, None)
    shown.run(one.end + 1.0, shown.pose, 0.2)
    assert shown.content['note'] == other.words
