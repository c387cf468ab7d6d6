# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device on the page: what is drawn of its topics, and when it no longer is."""

import json
from math import degrees, pi, radians
import re
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from mechanism import SINGULAR_PHI
import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    matrix_from_quaternion,
    mechanism_angles,
    workspace_pose,
)
from spm_haptic_master.kinematics.joints import (
    ALL_JOINT_NAMES,
    JOINT_NAMES,
    MECHANISM_JOINT_NAMES,
)
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.nodes.simulation_control import FAULT_TOPIC, FAULTS_TOPIC, STEER_TOPIC
from spm_haptic_master.parameters.geometry import mechanism_checksum
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.steering import PHI_LIMITS
from spm_haptic_master.view.status import Light, SensorState
from std_msgs.msg import Float64MultiArray, String

pytest.importorskip('viser', reason='viser is not installed (extra view)')
arm_module = pytest.importorskip('spm_haptic_master.view.arm')
status_module = pytest.importorskip('spm_haptic_master.view.status')
page_module = pytest.importorskip('spm_haptic_master.view.page')
stories = pytest.importorskip('spm_haptic_master.view.simulated_device').stories
RADIUS = pytest.importorskip('spm_haptic_master.view.scene').RADIUS

GEOMETRY = Geometry()
# Time between two ticks, and between two joint angles (s).
TICK = 0.05
# Time after which all of the picture is there (s).
WHOLE = arm_module.DEVICE_ALONE + 1.0


class Sampled:
    """A topic of which the newest message is the test's."""

    def __init__(self, node, kind, topic):
        self._node, self._topic = node, topic

    def subscribe(self):
        self._node.sampled.add(self._topic)

    def unsubscribe(self):
        self._node.sampled.discard(self._topic)

    def take(self):
        return self._node.newest.pop(self._topic, None)


class Shown:
    """A device on a real page, and the node that it has: of the test's topics, on its clock."""

    def __init__(self, server):
        self.server, self.now, self.watched = server, 1000.0, True
        self.takers, self.newest, self.sampled, self.published = {}, {}, set(), []
        # Parameters of fkm, when it was asked for them; whether a calibration runs.
        self.parameters, self.asked, self.calibrates = {}, [], True
        self.happened, self._samples = [], 0

    def create_subscription(self, kind, topic, take, qos):
        self.takers[topic] = take

    def create_publisher(self, kind, topic, qos):
        return SimpleNamespace(publish=lambda sent: self.published.append(
            (topic.removeprefix('/'), getattr(sent.data, 'tolist', lambda: sent.data)())))

    def create_client(self, kind, name):
        def ask(request):
            self.asked.append(self.now)
            values = complete(status_module.SETTINGS, self.parameters)
            answer = SimpleNamespace(values=[Parameter(
                name, value=list(values[name]) if isinstance(values[name], tuple)
                else values[name]).get_parameter_value() for name in request.names])
            future = SimpleNamespace(result=lambda: answer)
            return SimpleNamespace(add_done_callback=lambda take: take(future))

        return SimpleNamespace(service_is_ready=lambda: self.parameters is not None,
                               call_async=ask)

    def count_publishers(self, topic):
        return int(self.calibrates and topic == f'/{COVERAGE_TOPIC}')

    def begin(self, state='healthy', source='', **parameters):
        """Show the device with parameters of its fkm, in a state."""
        self.parameters = parameters
        self.arm = arm_module.Arm(self, self, page_module.Page(self.server), '/', 0)
        self.arm.tick(self.now)
        self.state(state)
        if source:
            self.say('source', source)
        return self

    def say(self, topic, text):
        self.takers[f'/{topic}'](String(data=text))

    def state(self, text):
        self.say('state', text)

    def pose(self, tilt=0.1, azimuth=0.0, phi=0.6, again=False):
        """Have new joint angles of a pose, rad; return its matrix."""
        R = workspace_pose(tilt, azimuth, phi)
        self._samples += not again
        message = JointState(name=list(MECHANISM_JOINT_NAMES),
                             position=mechanism_angles(tuple(R.ravel()), GEOMETRY))
        message.header.stamp.sec = self._samples
        self.takers['/joint_states'](message)
        return R

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

    def operate(self, label, value=None):
        """Operate the control with a label as a client does; return what was published."""
        control = self.control(label)
        if value is not None:
            control._impl.value = value
        self.published.clear()
        for act in control._impl.update_cb:
            act(SimpleNamespace(client=object(), target=control))
        return self.published

    def control(self, label):
        return next(each for each in self.server.gui._gui_input_handle_from_uuid.values()
                    if each.label == label)

    @property
    def scene(self):
        return self.arm._scene

    @property
    def text(self):
        return self.arm._page.shown[''].text

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
        dome = self.scene.dome
        return [dome.tiles, dome.singular, dome.rim, dome.trace, dome.pin, self.scene.level,
                *self.scene.labels]


@pytest.fixture
def shown(serve, monkeypatch):
    """Give a Shown that has not begun."""
    server = serve()
    server.gui.reset()
    server.scene.reset()
    made = Shown(server)
    monkeypatch.setattr(arm_module, 'time', SimpleNamespace(monotonic=lambda: made.now))
    monkeypatch.setattr(arm_module, 'SampledTopic', Sampled)
    monkeypatch.setattr(server, 'get_clients', lambda: {0: None} if made.watched else {})
    return made


def turn_of(handle):
    return matrix_from_quaternion(np.roll(handle.wxyz, -1))


def test_what_is_shown_is_the_pose_all_the_way_through_the_singularity(shown):
    """By other formulas: platform, trace, map, figures, and three encoders alone."""
    shown.begin(alert_limit_deg=2.0)
    shown.run(WHOLE, shown.pose)
    rng, errors = np.random.default_rng(5), []
    for phi in np.arange(SINGULAR_PHI - 0.2, SINGULAR_PHI + 0.25, 0.004):
        tilt, azimuth = 0.0005, 3.0 * phi
        R = workspace_pose(tilt, azimuth, phi)
        eta = float(dexterity(R)), float(dexterity(R, sensors=4))
        shown.newest['/dexterity'] = Float64MultiArray(data=eta)
        readings = np.array(mechanism_angles(tuple(R.ravel()), GEOMETRY))[[0, 3, 6, 2]]
        message = JointState(name=list(JOINT_NAMES), position=readings + radians(0.04)
                             * rng.standard_normal(4))
        message.header.stamp.sec, message.header.stamp.nanosec = shown._samples, 999_999_999
        shown.newest['/readings'] = message
        shown.run(TICK, lambda: shown.pose(tilt, azimuth, phi))  # noqa: B023
        np.testing.assert_allclose(turn_of(shown.scene._frame), R, atol=1e-6)
        sample = shown.content['sample']['values']
        errors.append((eta[0], sample['ghost'][0]))
    ghost = shown.scene.ghost
    assert ghost.visible and ghost.name.startswith(f'{shown.scene._frame.name}/')
    assert 2.0 * degrees(np.arccos(abs(ghost.wxyz[0]))) == pytest.approx(errors[-1][1], abs=0.5)
    shown.run(1.0, lambda: shown.pose(tilt, azimuth, phi))
    np.testing.assert_allclose(shown.scene.dome.pin.position, RADIUS * R[:, 2], atol=1e-6)
    psi, theta = np.arctan2(R[0, 2], -R[1, 2]), np.arccos(R[2, 2])
    euler = np.degrees([psi, theta, np.arctan2(R[2, 0], R[2, 1])])
    assert shown.rows['orientation'] == ', '.join(
        f'{name} {angle:.2f}\u00b0' for name, angle in zip('ψθφ', euler, strict=True))
    assert [shown.rows[f'dexterity of {count}'] for count in (3, 4)] == [
        f'{each:.3f}' for each in eta]
    assert [plot['limits'] for plot in shown.content['plots'] if plot['key'] == 'level'] == [
        [(2.0, page_module.LIMIT)]]
    values = shown.content['sample']['values']
    np.testing.assert_allclose(values['angles'], np.degrees(readings), atol=1e-6)
    np.testing.assert_array_equal(shown.scene.dome.tiles.batched_colors,
                                  shown.scene.dome._map.colours(euler[2] / 180.0 * pi))
    # Noise alone clear of the singularity, and more at it.
    near, clear = ([error for three, error in errors if low < three < high]
                   for low, high in ((0.0, 0.02), (0.12, 1.0)))
    assert len(clear) > 3 and max(near) > 1.0 > 2.0 * np.nanmax(clear)
    # Readings of another robot, or a dexterity of another number, are none.
    shown.newest['/dexterity'] = Float64MultiArray(data=[0.1])
    shown.run(1.0, shown.pose)
    assert shown.rows['dexterity of 3'] == shown.rows['three encoders'] == '\u2013'


def test_fkm_is_asked_again_and_only_another_mechanism_or_mounting_is_drawn_anew(shown):
    """By the checksum at once, though its state was healthy before and is healthy now."""
    shown.begin()
    before = shown.scene
    same, other = (mechanism_checksum(complete(status_module.SETTINGS, each))
                   for each in ({}, {'geometry.beta_deg': 36.0}))
    shown.run(4.0, lambda: shown.fkm(mechanism=same))
    assert len(shown.asked) == 1
    shown.run(12.0, shown.fkm)
    assert np.diff(shown.asked) == pytest.approx(status_module.ASK_PERIOD, abs=0.06)
    assert shown.scene is before
    # Another mounting is no part of the checksum.
    shown.parameters = {'mounting.base_zxz_deg': [0.0, 90.0, 0.0]}
    shown.run(5.1, shown.fkm)
    assert shown.scene is not before and before._root._impl.removed
    assert before._floor._impl.removed
    np.testing.assert_allclose(turn_of(shown.scene._root), [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
                               atol=1e-6)
    before, shown.parameters = shown.scene, {'geometry.beta_deg': 36.0}
    shown.run(1.1, lambda: shown.fkm(mechanism=other))
    assert shown.scene is not before
    # What cannot be assembled is asked for again soon.
    shown.parameters = {'geometry.alpha_deg': 80.0, 'geometry.beta_deg': 20.0}
    shown.run(5.1, shown.fkm)
    shown.asked.clear()
    shown.run(3.1)
    assert np.diff(shown.asked) == pytest.approx(status_module.ANSWER_TIMEOUT, abs=0.06)


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
    """An old value does not keep the picture alive, nor does another robot's or a silent one."""
    shown.begin()
    shown.run(1.0, shown.pose)
    drawn = shown.scene._frame.wxyz
    shown.run(1.2, lambda: shown.pose(0.3, again=True))
    assert shown.text == 'no joint_states for 1 s (diagnostics)'
    for name, position in ((['joint_1'] * 9, [0.0] * 9),
                           (list(MECHANISM_JOINT_NAMES), [np.nan] * 9)):
        shown.takers['/joint_states'](JointState(name=name, position=position))
        shown.run(TICK)
        assert not shown.arm.seen.banner.alive
    shown.state('silent: no joint samples')
    shown.run(0.5, lambda: shown.pose(0.3))
    np.testing.assert_array_equal(shown.scene._frame.wxyz, drawn)


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
    assert 0.004 <= np.linalg.norm(line[:, 1] - line[:, 0], axis=-1).max() < 0.02


def test_a_mechanism_that_reaches_little_is_drawn_at_the_centre(shown):
    """There it can be assembled, as any that is not refused; elsewhere it need not."""
    shown.begin(**{'geometry.alpha_deg': 20.0, 'geometry.beta_deg': 20.0,
                   'geometry.gamma_deg': 90.0})
    R = workspace_pose(0.0, 0.0, 0.0)
    np.testing.assert_allclose(turn_of(shown.scene._frame), R, atol=1e-6)
    # Upright: the handle is vertical.
    np.testing.assert_allclose(turn_of(shown.scene._root) @ np.ones(3), [0.0, 0.0, 3.0 ** 0.5],
                               atol=1e-6)


@pytest.mark.parametrize(('level', 'half_angle'), [(0.5, 5.0), (3.0, 20.05)])
def test_the_cone_of_the_protection_level(shown, level, half_angle):
    """Ten times as wide as it is, and never wider than a cone on the dome is legible."""
    shown.begin()
    shown.run(WHOLE, lambda: shown.fkm(**{'protection level (deg)': str(level)}))
    cone = shown.scene.level
    assert cone.visible
    assert np.degrees(np.arctan(cone.scale)) == pytest.approx([half_angle] * 2 + [45.0], abs=0.01)
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
    shown.parameters = {'geometry.beta_deg': 34.0}
    shown.run(6.0, shown.fkm)
    assert shown.scene is not scene and all(each.visible for each in shown.beside())
    # Figures that are not seen end the cone at once, and the axes have the colour of a silence.
    shown.state('silent: x')
    assert not shown.scene.level.visible


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

    shown.run(1.0, one_more, period=1.0 / rate)
    assert least <= np.mean(rates[len(rates) // 2:]) <= most
    shown.run(1.0)
    assert shown.rows['picture'] == '0 poses a second'


def test_the_arrows_of_torques_and_the_state_of_the_force_feedback(shown):
    """By their topics; arrows end when torques do."""
    arrows = shown.begin().scene.torques

    def torque(size, *names):
        for name in names:
            message = WrenchStamped()
            message.wrench.torque.x = size
            shown.newest[f'/body/{name}_cf'] = message
        shown.pose()

    shown.run(TICK, lambda: torque(0.2, 'servo', 'measured'))
    for arrow in arrows:
        # Along x, three units for 1 N m.
        tip = turn_of(arrow) @ [0.0, 0.0, arrow.scale[2]]
        np.testing.assert_allclose(tip, [0.6, 0.0, 0.0], atol=1e-6)
    assert shown.sampled == {'/dexterity', '/readings', '/body/servo_cf', '/body/measured_cf'}
    # What is too small to be seen has no arrow, and what no longer comes.
    for size, least in ((0.001, False), (0.006, True)):
        shown.run(TICK, lambda: torque(size, 'servo', 'measured'))  # noqa: B023
        assert [arrow.visible for arrow in arrows] == [least, least]
    shown.run(0.4, lambda: torque(0.2, 'servo'))
    assert [arrow.visible for arrow in arrows] == [True, False]
    shown.state('silent: x')
    shown.run(TICK, lambda: torque(0.2, 'servo', 'measured'))
    assert not any(arrow.visible for arrow in arrows)
    # Words of another program are no state of the force feedback.
    for words, figure in (('fading: no hand on the handle',) * 2, ('strong', '\u2013')):
        shown.say('force_state', words)
        shown.run(0.5, shown.pose)
        assert shown.rows['force'] == figure
    # What nobody looks at is not subscribed to.
    shown.watched = False
    shown.run(TICK)
    assert not shown.sampled


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
    assert list(dict.fromkeys(shown.happened))[6:] == [
        'th3A not checked by the others', 'th1B faulty, excluded']


def test_a_calibration_is_shown_until_it_ends(shown):
    """A killed program leaves no last word; words of another program are none."""
    shown.begin()

    def says(text):
        shown.say(COVERAGE_TOPIC, text)
        shown.run(0.5)
        return shown.content['calibration']

    found = {'text': 'turn it', 'covered': {'tilt': 0.89, 'turn': 0.9, 'none': float('nan')}}
    expected = {'text': 'turn it', 'covered': [('tilt', 0.89, Light.AMBER.value),
                                               ('turn', 0.9, Light.GREEN.value)]}
    assert says(json.dumps(found)) == says('[1]') == says('turn') == expected
    assert says('{}') is None
    assert says(json.dumps(found)) == expected
    shown.calibrates = False
    shown.run(0.5)
    assert shown.content['calibration'] is None


def test_the_ghost_is_over_a_device_that_is_alive(shown):
    ghost, turn = shown.begin().scene.ghost, (0.0, 0.0, 0.1, 0.99 ** 0.5)

    def three():
        shown.fkm()
        shown.arm._ghost.turn = turn

    shown.run(1.0, three)
    assert not ghost.visible
    shown.run(WHOLE, three)
    assert ghost.visible
    np.testing.assert_allclose(ghost.wxyz, [0.99 ** 0.5, 0.0, 0.0, 0.1])
    assert shown.rows['three encoders'] == '11.48\u00b0 off'
    shown.state('silent: no joint samples')
    shown.run(0.5)
    assert not ghost.visible


def test_the_knobs_are_those_of_a_simulated_device_alone(shown):
    """Faults are added one by one; another offset of a joint replaces the one before."""
    shown.begin(source='can: can0')
    assert not shown.server.gui._gui_input_handle_from_uuid
    shown.say('source', 'sim')
    for kind, joint, offset, expected in (
            ('offset', 'joint_1b', 5.0, 'offset:joint_1b=5'),
            ('stuck', 'joint_1b', 5.0, 'offset:joint_1b=5, stuck:joint_1b'),
            ('offset', 'joint_3a', 5.0, 'offset:joint_1b=5, stuck:joint_1b, offset:joint_3a=5'),
            ('offset', 'joint_1b', 1.0, 'stuck:joint_1b, offset:joint_3a=5, offset:joint_1b=1'),
            ('stuck', 'joint_1b', 1.0, 'offset:joint_3a=5, offset:joint_1b=1, stuck:joint_1b')):
        shown.control('encoder')._impl.value = joint
        shown.control('offset, deg')._impl.value = offset
        assert shown.operate('fault', kind) == [(FAULT_TOPIC, expected)]
        shown.say(FAULTS_TOPIC, expected)
        assert f'faults: {expected}<' in shown.arm.simulation._faults_html.content
    shown.run(0.5, shown.pose)
    assert shown.happened[:2] == ['faults: offset:joint_1b=5',
                                  'faults: offset:joint_1b=5, stuck:joint_1b']
    assert shown.operate('no fault') == [(FAULT_TOPIC, '')]
    # As many encoders as there are; none without a simulation.
    encoders = shown.control('encoder')
    assert list(encoders.options) == list(ALL_JOINT_NAMES[:4])
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
    limits = [(shown.control(label).min, shown.control(label).max) for label in labels]
    assert limits == [(0, 20), (-180, 180), (-40, 65)]

    def sliders(*degrees):
        shown.run(0.5, lambda: shown.pose(*np.radians(degrees)))
        return [shown.control(label).value for label in labels]

    assert sliders(10.0, 40.0, 30.3) == [10.0, 40.0, 30.5]
    assert not shown.published
    shown.operate('cross the singularity')
    (topic, pose), = shown.operate(labels[0], 9.0)
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
    """From clear of the singularity, where it leads, to clear of it."""
    shown.begin(source='sim', sensors=sensors)
    story, period, done, expected = stories(sensors)[number], 0.25, [], []
    # It takes the place of another one.
    shown.operate(stories(sensors)[number - 1].name)
    shown.run(0.25, shown.pose, period)
    shown.operate(story.name)
    began = shown.now + period

    def note():
        done.extend((shown.now - period, *each) for each in shown.published)
        shown.published.clear()
        shown.pose()

    shown.run(1.0, note, period)
    assert shown.content['note'] == story.words
    shown.run(story.end, note, period)
    assert shown.content['note'] != story.words
    for at, phi, faults in story.steps:
        if faults is not None:
            expected.append((at, FAULT_TOPIC, faults))
            assert not faults or parse_switched(faults, sensors)
        if phi is not None:
            expected.append((at, STEER_TOPIC, [0.0, 0.0, radians(phi)]))
            assert PHI_LIMITS[0] <= radians(phi) <= PHI_LIMITS[1]
    expected.append((story.end, STEER_TOPIC, []))
    assert [each[1:] for each in done] == [each[1:] for each in expected]
    assert np.abs(np.subtract([each[0] for each in done], [each[0] for each in expected])
                  - began).max() <= 1.1 * period
    assert [each[2] for each in done if each[1] == FAULT_TOPIC][-1:] in ([], [''])


def test_the_stories_lead_to_the_singularity_and_across_it():
    (cross, broken, unplugged), = {stories(4)}
    phis = [step.phi for step in cross.steps]
    assert degrees(SINGULAR_PHI) == pytest.approx(phis[1], abs=0.05)
    etas = [float(dexterity(workspace_pose(0.0, 0.0, radians(phi)))) for phi in phis]
    # It begins and ends clear of it, and is near it on its other side in between.
    assert etas[1] < 0.001 and min(etas[0], *etas[3:]) > 0.1 > etas[2] > 0.05
    assert phis[0] == phis[-1] < phis[1] < phis[2] < phis[3] and broken.steps[0].phi == phis[1]
    for story in (cross, broken, unplugged):
        times = [step.at for step in story.steps] + [story.end]
        assert times[0] == 0.0 and all(1.9 < each < 8.0 for each in np.diff(times))


def test_a_story_that_begins_as_another_one_ends_is_played(shown):
    """Its button is pressed in another thread than the ticks are in."""
    shown.begin(source='sim')
    one, other, _ = stories(4)
    simulation = shown.arm.simulation
    simulation._steer = lambda *pose: pose or simulation._play(other, None)
    shown.operate(one.name)
    shown.run(one.end + 1.0, shown.pose, 0.2)
    assert shown.content['note'] == other.words
