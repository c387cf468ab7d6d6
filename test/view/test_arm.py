# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device on the page: what is drawn of its topics, and when it no longer is."""

import gc
import re
from types import SimpleNamespace
import weakref

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState
from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics import (
    Geometry,
    matrix_from_quaternion,
    mechanism_angles,
    workspace_pose,
)
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.parameters.geometry import mechanism_checksum
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.ros.qos import STATE
from spm_haptic_master.simulation.stories import stories
from spm_haptic_master.view.liveness import Light
from spm_haptic_master.view.sensor_states import SensorState
from std_msgs.msg import Float64MultiArray, String

pytest.importorskip('viser', reason='viser is not installed (extra view)')
arm_module = pytest.importorskip('spm_haptic_master.view.arm')
mechanism_query = pytest.importorskip('spm_haptic_master.view.mechanism_query')
page_module = pytest.importorskip('spm_haptic_master.view.page')
readout = pytest.importorskip('spm_haptic_master.view.readout')
view_node = pytest.importorskip('spm_haptic_master.view.node')

PATIENCE = 20.0
# Time between two ticks, and between two joint angles (s).
TICK = 0.05


class Shown:
    """
    An Arm on a real page that somebody looks at, on a clock of the test.

    Parameters
    ----------
    node : Node
        Node of the arm.
    server : ViserServer
        Server of the page.

    """

    def __init__(self, node, server):
        self.now = 1000.0
        self.node, self.server = node, server
        self.arm = None
        self._samples = 0
        self._happened = []

    def begin(self, taker=None, **values):
        """Make the arm, with the mechanism of some settings already drawn."""
        self.arm = arm_module.Arm(
            self.node, taker or self.node, self.server,
            page_module.Page(self.server, view_node.views(1)), '/', 0)
        self.arm._query.take(complete(mechanism_query.SETTINGS, values))
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

    def entry(self, name, message, level=DiagnosticStatus.OK, **values):
        """Have an entry on /diagnostics; _ in a key stands for a space."""
        self.arm.on_diagnostics(DiagnosticStatus(
            level=level, name=name, message=message, values=[
                KeyValue(key=key, value=value) for key, value in values.items()]))

    def run(self, seconds, each=lambda: None, period=TICK):
        """Let time pass, with something before each tick."""
        for _ in range(round(seconds / period)):
            self.now += period
            each()
            self.arm.tick(self.now)
            if self.arm._page.content:
                self._happened += self.content['sample']['happened']

    @property
    def knobs(self):
        """Return the knobs of the device, which is simulated."""
        if self.arm.simulation.knobs is None:
            self.arm._on_source(String(data='sim'))
        return self.arm.simulation.knobs

    @property
    def text(self):
        return self.arm._banner.text

    @property
    def content(self):
        """Return what the page has of the device."""
        return self.arm._page.content['']

    @property
    def figures(self):
        """Return the rows of figures as text."""
        rows = self.content['rows'] if self.arm._page.content else ()
        return '\n'.join(f'{name}: {text}' for name, text, *_ in rows)

    @property
    def happened(self):
        """Return the events of all times."""
        return self._happened

    @property
    def values(self):
        """Return the latest values of the plots."""
        return self.content['sample']['values']


@pytest.fixture(scope='module')
def server():
    """Start a server of the page."""
    made = view_node._server('127.0.0.1', 28380)
    yield made
    made.stop()


@pytest.fixture
def shown(observer, server, monkeypatch):
    """Give a Shown that has not begun."""
    server.gui.reset()
    server.scene.reset()
    made = Shown(observer.node, server)
    monkeypatch.setattr(arm_module, 'time', SimpleNamespace(monotonic=lambda: made.now))
    monkeypatch.setattr(server, 'get_clients', lambda: {0: None})
    return made


@pytest.fixture
def another_fkm(observer):
    """Make a node `fkm` with some settings that are not the defaults."""
    nodes = []

    def make(**given):
        values = complete(mechanism_query.SETTINGS, {
            name.replace('__', '.'): value for name, value in given.items()})
        nodes.append(Node('fkm', context=observer.context))
        observer._executor.add_node(nodes[-1])
        for name, value in values.items():
            nodes[-1].declare_parameter(name, list(value) if isinstance(value, tuple) else value)
        return values

    yield make
    for node in nodes:
        node.destroy_node()


def test_another_mechanism_of_a_restarted_fkm_is_asked_for(shown, observer, another_fkm,
                                                           monkeypatch):
    """Its state was healthy before and is healthy now: `starting` was never seen."""
    other = another_fkm(geometry__beta_deg=36.0)
    shown.begin()
    # The answer that has been, and no question for its own sake.
    monkeypatch.setattr(mechanism_query, 'ASK_PERIOD', 1e9)
    shown.arm._query._asked_at, shown.arm._query._answered = 0.0, True
    before = shown.arm._geometry
    own = mechanism_checksum(complete(mechanism_query.SETTINGS, {}))

    def drawn(mechanism):
        shown.state('healthy')
        shown.entry('fkm: orientation', 'healthy', mechanism=mechanism)
        return observer.spin_until(
            lambda: shown.run(TICK) or shown.arm._geometry != before, 2.0)

    assert not drawn(own)
    assert drawn(mechanism_checksum(other))
    assert shown.arm._query._checksum == mechanism_checksum(other)


def test_another_mounting_of_a_restarted_fkm_is_found(shown, observer, another_fkm):
    """It is no part of the mechanism's checksum."""
    another_fkm(mounting__base_zxz_deg=[0.0, 90.0, 0.0])
    shown.begin()
    before = shown.arm._mounting
    shown.arm._query._asked_at, shown.arm._query._answered = shown.now, True
    assert observer.spin_until(lambda: shown.run(TICK) or shown.arm._mounting != before, PATIENCE)


def test_a_mechanism_is_not_drawn_anew_while_it_stays_the_same(shown, observer, another_fkm,
                                                               monkeypatch):
    another_fkm()
    shown.begin()
    built = []
    monkeypatch.setattr(shown.arm._query, '_build', built.append)
    asked = []
    call = shown.arm._query._client.call_async
    monkeypatch.setattr(shown.arm._query._client, 'call_async',
                        lambda request: asked.append(shown.now) or call(request))
    assert observer.spin_until(
        lambda: shown.run(TICK) or (len(asked) >= 3 and shown.arm._query._answered), PATIENCE)
    assert built == []


def test_figures_that_no_longer_come_are_not_shown(shown):
    """Beside a red banner, nothing says how it was; the plots run on, without values."""
    shown.begin()
    shown.state('healthy')

    def all_is_well():
        shown.pose()
        if round(shown.now / TICK) % 20 == 0:
            shown.entry('encoder_driver: encoders', 'publishing [sim]')
            shown.entry('fkm: orientation', 'healthy; joint_3a: unchecked',
                        caution='joint_3a: unchecked',
                        **{'parity (sigma)': '0.5', 'protection level (deg)': '0.3'})
            shown.entry('fkm: timing', 'in time', **{
                'orientation rate (Hz)': '1000', 'latency p50 (us)': '130',
                'latency p99 (us)': '300'})

    shown.run(4.0, all_is_well)
    words = 'publishing [sim]', '1000 Hz', 'p50 130 us', 'joint_3a: unchecked'
    assert all(word in shown.figures for word in words)
    assert shown.values['parity'] == [0.5] and shown.values['latency'] == [130.0, 300.0]
    names = [name for name, *_ in shown.content['rows']]

    shown.run(3.5)
    assert not any(word in shown.figures for word in words)
    assert np.isnan([*shown.values['parity'], *shown.values['latency']]).all()
    # They leave a dash where they were.
    assert [name for name, *_ in shown.content['rows']] == names
    assert f'parity: {readout.DASH}' in shown.figures


def test_what_is_missing_is_said_and_why(shown):
    """Orientations go out, but diagnostics does not publish joint_states of them."""
    shown.begin()
    shown.state('healthy')

    def fkm():
        shown.entry('fkm: orientation', 'healthy')

    shown.run(1.0, lambda: shown.pose() or fkm() or shown.entry(
        'diagnostics: singularity', 'near a singularity of the sensors in use',
        DiagnosticStatus.WARN))
    assert shown.text == 'healthy'
    # Its process is stopped; what it said before is no reason.
    shown.run(0.4, fkm)
    assert shown.text == 'no joint_states for 0.25 s (diagnostics)'
    assert not shown.arm._banner.alive
    shown.run(4.0, lambda: fkm() or shown.entry(
        'diagnostics: singularity', 'outside the working mode', DiagnosticStatus.ERROR))
    assert shown.text == 'no joint_states for 4 s (diagnostics: outside the working mode)'
    assert not shown.arm._scene._alive
    # Without any news the state is an old one.
    shown.run(3.0)
    assert shown.text == 'silent: nothing from fkm, no joint_states for 7 s'
    shown.state('silent: no joint samples')
    assert shown.text == 'silent: no joint samples'


def test_slow_ticks_do_not_slow_down_the_clock(shown):
    """On a machine without time for this process, a silence is as long as it is."""
    shown.begin()
    shown.state('healthy')
    shown.run(2.0, shown.pose, period=0.5)
    assert shown.text == 'healthy'
    shown.run(0.5, period=0.5)
    assert shown.text != 'healthy'
    assert shown.arm._age.value == pytest.approx(0.5, abs=1e-6)


def test_a_pause_of_the_program_itself_is_no_silence_of_the_device(shown):
    """Its first tick comes before the joint angles that have come meanwhile are read."""
    shown.begin()
    shown.state('healthy')
    shown.run(1.0, shown.pose)
    shown.run(1.0, period=1.0)
    assert shown.text == 'healthy'
    # None had come: it shows at the next tick.
    shown.run(TICK)
    assert shown.text == 'no joint_states for 1 s (diagnostics)'


def test_a_mechanism_drawn_anew_leaves_nothing_of_the_old_one(shown):
    shown.begin()
    shown.run(arm_module.DEVICE_ALONE + 2.0 * TICK)
    old = [weakref.ref(shown.arm._scene)]
    for _ in range(3):
        shown.arm._build(complete(mechanism_query.SETTINGS, {}))
        old.append(weakref.ref(shown.arm._scene))
    assert shown.arm._scene._tiles.visible and shown.arm._scene._line.visible
    gc.collect()
    assert [scene() for scene in old[:-1]] == [None] * 3


def test_a_calibration_ends_with_its_program(shown, observer):
    """A killed program leaves no last word; what it said before is not the present."""
    shown.begin()
    out = observer.node.create_publisher(String, COVERAGE_TOPIC, STATE)
    out.publish(String(data='{"text": "turn it", "covered": {"precision": 0.4, "tilt": NaN}}'))

    def calibration():
        shown.run(0.5)
        return shown.content['calibration']

    assert observer.spin_until(calibration, PATIENCE)
    shown.arm.check_calibration()
    assert calibration() == {
        'text': 'turn it', 'covered': [('precision', 0.4, Light.AMBER.value)]}
    observer.node.destroy_publisher(out)
    assert observer.spin_until(
        lambda: shown.arm.check_calibration() or calibration() is None, PATIENCE)


@pytest.mark.parametrize('ends', ['silence', 'nobody looks'])
def test_no_way_is_drawn_that_nobody_has_seen(shown, monkeypatch, ends):
    """In the trace, when the device or the page comes back."""
    shown.begin()
    shown.state('healthy')
    place = iter(np.arange(0.0, 1.0, 0.002))
    shown.run(2.0, lambda: shown.pose(0.3, next(place)))
    if ends == 'silence':
        shown.run(3.0)
    else:
        monkeypatch.setattr(shown.server, 'get_clients', dict)
        shown.run(3.0, lambda: shown.pose(0.3, 2.0))
        monkeypatch.setattr(shown.server, 'get_clients', lambda: {0: None})
    place = iter(np.arange(3.1, 4.0, 0.002))
    shown.run(2.0, lambda: shown.pose(0.3, next(place)))
    line = shown.arm._scene._line.points
    assert len(line) > 10
    assert np.linalg.norm(line[:, 1] - line[:, 0], axis=-1).max() < 0.02


def test_another_offset_replaces_that_before(shown):
    """And nothing else: other faults stay, and one that is there is not there twice."""
    shown.begin()
    knobs, asked = shown.knobs, []
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
        knobs.show(expected)


def test_a_mechanism_that_reaches_little_is_drawn(shown):
    """At the centre it can be assembled, as any that is not refused; elsewhere it need not."""
    narrow = {'geometry.alpha_deg': 20.0, 'geometry.beta_deg': 20.0, 'geometry.gamma_deg': 90.0}
    shown.begin()
    shown.arm._query.take(complete(mechanism_query.SETTINGS, narrow))
    assert shown.arm._scene is not None
    shown.state('healthy')
    shown.run(0.4, lambda: shown.pose(0.0, 0.0, 0.0))
    assert shown.text == 'healthy'


@pytest.mark.parametrize(('level', 'half_angle'), [(0.5, 5.0), (3.0, 20.05)])
def test_the_cone_of_the_protection_level(shown, level, half_angle):
    """Ten times as wide as it is, and never wider than a cone on the dome is legible."""
    shown.begin()
    shown.state('healthy')
    shown.run(arm_module.DEVICE_ALONE + 1.0, lambda: shown.pose() or shown.entry(
        'fkm: orientation', 'healthy', **{'protection level (deg)': str(level)}))
    cone = shown.arm._scene._level
    assert cone.visible
    assert np.degrees(np.arctan(cone.scale[0])) == pytest.approx(half_angle, abs=0.01)
    shown.run(0.4, lambda: shown.pose() or shown.entry(
        'fkm: orientation', 'healthy', parity='0.5'))
    assert not cone.visible


def beside_the_device(arm):
    """Return what of the page is beside the device and its state."""
    scene = arm._scene
    return [scene._tiles, scene._singular, scene._rim, scene._line, scene._pin, scene._level,
            *scene.overlay.labels]


def seen(arm):
    return [each.visible for each in beside_the_device(arm)]


@pytest.fixture
def begun(shown):
    """Begin, healthy, with what makes all of the picture visible."""
    shown.begin()
    shown.state('healthy')

    def pose():
        shown.pose()
        shown.entry('fkm: orientation', 'healthy', **{'protection level (deg)': '0.5'})

    shown.once = pose
    return shown


def test_the_device_comes_before_what_is_beside_it(begun, monkeypatch):
    """Before anybody sees the device, that time does not begin."""
    shown = begun
    monkeypatch.setattr(shown.server, 'get_clients', dict)
    shown.run(arm_module.DEVICE_ALONE + 1.0, shown.once)
    monkeypatch.setattr(shown.server, 'get_clients', lambda: {0: None})
    shown.run(1.0, shown.once)
    monkeypatch.setattr(shown.server, 'get_clients', dict)
    shown.run(arm_module.DEVICE_ALONE, shown.once)
    monkeypatch.setattr(shown.server, 'get_clients', lambda: {0: None})
    scene, shown.arm._scene = shown.arm._scene, None
    shown.run(arm_module.DEVICE_ALONE, shown.once)
    shown.arm._scene = scene
    shown.run(arm_module.DEVICE_ALONE - 0.5, shown.once)
    assert scene._alive
    assert not any(seen(shown.arm))
    shown.run(1.5, shown.once)
    assert all(seen(shown.arm))
    # It stays for a mechanism that is drawn anew.
    shown.arm._build(complete(mechanism_query.SETTINGS, {}))
    shown.run(1.0, shown.once)
    assert all(seen(shown.arm))


@pytest.mark.parametrize('after', [1.0, 6.0])
def test_the_map_of_a_silent_device_is_that_of_its_last_pose(begun, after):
    """Whether the silence comes before the map or after; and nothing is at the centre."""
    shown, scene = begun, begun.arm._scene
    shown.run(after, lambda: shown.pose(phi=0.6))
    shown.state('silent: no joint samples')
    shown.run(arm_module.DEVICE_ALONE + 1.0)
    shown.run(TICK)
    np.testing.assert_array_equal(scene._tiles.batched_colors, scene._map.colours(0.6))
    assert scene._singular.visible
    assert len(scene._singular.points) == len(scene._map.singular_axes(0.6)) > 1


def test_a_device_that_was_never_alive_has_no_place_on_the_map(shown):
    shown.begin()
    shown.state('silent: no joint samples')
    shown.run(arm_module.DEVICE_ALONE + 1.0)
    scene = shown.arm._scene
    assert scene._tiles.visible
    assert not scene._pin.visible and not scene._singular.visible


@pytest.mark.parametrize(('rate', 'least', 'most'), [(60.0, 57.0, 63.0), (500.0, 57.0, 84.0)])
def test_every_pose_at_60_hz_is_drawn_and_no_faster_than_is_seen(shown, rate, least, most):
    shown.begin()
    shown.state('healthy')
    rates = []

    def one_more():
        shown.pose()
        rates.extend(map(float, re.findall(r'(\d+) poses a second', shown.figures)))

    shown.run(4.0, one_more, period=1.0 / rate)
    settled = rates[len(rates) // 2:]
    assert least <= np.mean(settled) <= most
    shown.run(1.0)
    assert 'picture: 0 poses a second' in shown.figures


def test_figures_of_an_orientation(shown, observer):
    taker = Node('taker_of_dexterity', context=observer.context)
    out = observer.node.create_publisher(Float64MultiArray, 'dexterity', 1)
    shown.begin(taker)
    shown.state('healthy')

    def drawn():
        out.publish(Float64MultiArray(data=[0.021, 0.4]))
        shown.entry('fkm: orientation', 'healthy',
                    **{'protection level (deg)': '0.31', 'parity (sigma)': '1.25'})
        shown.entry('diagnostics: singularity', 'near a singularity', DiagnosticStatus.OK, **{
            'warn below': '0.059', 'error below': '0.033'})
        shown.run(0.4, shown.pose)
        return 'dexterity of 3: 0.021' in shown.figures

    try:
        assert observer.spin_until(drawn, PATIENCE), shown.figures
    finally:
        taker.destroy_node()
    assert 'dexterity of 4: 0.400' in shown.figures
    assert '0.31\u00b0' in shown.figures and '1.2 sigma' in shown.figures
    # Both bars are fuller the better; three have a tenth of the full one.
    bars = [row[2:] for row in shown.content['rows'] if len(row) > 2]
    assert bars == [(pytest.approx(0.105), Light.RED.value), (2.0, Light.GREEN.value)]
    assert 'singularity: near a singularity' in shown.figures
    # theta of this pose: ZXZ angles are of the handle's axis from the base's z.
    assert '\u03b8 ' in shown.figures and '\u03c6 ' in shown.figures


def rgb(colour):
    return tuple(bytes.fromhex(colour[1:]))


def test_each_encoder_has_the_colour_of_its_state(shown):
    """In a silence, too: there it matters which one it is."""
    shown.begin(sensors=6)
    scene = shown.arm._scene
    assert len(scene._motors.batched_colors) == len(scene._others.batched_colors) == 3

    def colours():
        return [tuple(each) for handle in (scene._motors, scene._others)
                for each in handle.batched_colors]

    unchecked = {f'joint_{name} unchecked (s)': '0.0'
                 for name in ('1a', '1b', '1c', '3a', '3b', '3c')}
    shown.state('healthy')

    def fkm():
        shown.pose()
        shown.entry('fkm: orientation', 'healthy', **unchecked)

    shown.run(1.0, fkm)
    assert colours() == [rgb(SensorState.HEALTHY.value.colour)] * 6
    unchecked['joint_3a unchecked (s)'] = '4.0'
    shown.run(1.0, fkm)
    assert colours()[3] == rgb(SensorState.UNCHECKED.value.colour)
    assert 'th3A not checked by the others' in str(shown.happened)
    shown.state('silent: joint_1b stuck')
    shown.run(1.0, lambda: shown.entry('fkm: orientation', 'silent', **unchecked))
    assert colours()[1] == rgb(SensorState.EXCLUDED.value.colour)
    assert not scene._alive


def test_the_ghost_is_over_a_device_that_is_alive(begun):
    shown = begun
    ghost = shown.arm._scene.overlay.ghost
    shown.arm._ghost.turn = 0.0, 0.0, 0.1, (1.0 - 0.01) ** 0.5
    shown.run(1.0, shown.once)
    assert not ghost.visible
    shown.run(arm_module.DEVICE_ALONE + 1.0, lambda: shown.once() or setattr(
        shown.arm._ghost, 'turn', (0.0, 0.0, 0.1, (1.0 - 0.01) ** 0.5)))
    assert ghost.visible
    np.testing.assert_allclose(ghost.wxyz, [0.99 ** 0.5, 0.0, 0.0, 0.1])
    # It is the platform's child: at no error it is the platform.
    assert ghost.name.startswith(f'{shown.arm._scene._frame.name}/')
    assert shown.values['ghost'] == [pytest.approx(np.degrees(2.0 * np.arcsin(0.1)))]
    shown.state('silent: no joint samples')
    shown.run(0.5)
    assert not ghost.visible
    assert np.isnan(shown.values['ghost']).all()


def test_torques_are_arrows_as_long_as_they_come(shown, observer):
    taker = Node('taker_of_torques', context=observer.context)
    outs = [observer.node.create_publisher(WrenchStamped, f'body/{name}_cf', 1)
            for name in ('servo', 'measured')]
    shown.begin(taker)
    shown.state('healthy')
    arrows = shown.arm._scene.overlay.torques
    message = WrenchStamped()
    message.wrench.torque.x = 0.2

    def seen():
        for out in outs:
            out.publish(message)
        shown.run(TICK, shown.pose)
        return all(arrow.visible for arrow in arrows)

    try:
        assert observer.spin_until(seen, PATIENCE)
    finally:
        taker.destroy_node()
    for arrow in arrows:
        # Along x, three units for 1 N m.
        tip = matrix_from_quaternion(np.roll(arrow.wxyz, -1)) @ [0.0, 0.0, arrow.scale[2]]
        np.testing.assert_allclose(tip, [0.6, 0.0, 0.0], atol=1e-6)


def test_torques_that_no_longer_come_have_no_arrow(shown):
    shown.begin()
    shown.state('healthy')
    samples = shown.arm._samples
    samples.torques, samples._came = [(0.0, 0.1, 0.0), (0.0, 0.001, 0.0)], [shown.now] * 2
    shown.run(TICK, shown.pose)
    # The second is too small to be seen.
    arrows = shown.arm._scene.overlay.torques
    assert [arrow.visible for arrow in arrows] == [True, False]
    shown.run(1.0, shown.pose)
    assert not any(arrow.visible for arrow in arrows)


def test_the_sliders_follow_the_device_until_a_user_moves_one(shown):
    shown.begin()
    knobs, steered = shown.knobs, []
    knobs._steer = lambda *pose: steered.append(pose)
    shown.state('healthy')
    shown.run(1.0, lambda: shown.pose(np.radians(10.0), np.radians(40.0), np.radians(30.0)))
    assert [slider.value for slider in knobs.sliders] == [10.0, 40.0, 30.0]
    assert steered == []
    knobs.player.words = 'a story'
    knobs._on_slider(SimpleNamespace(client=object()))
    assert steered == [pytest.approx(np.radians([10.0, 40.0, 30.0]))]
    assert knobs.player.words == ''
    shown.run(1.0, lambda: shown.pose(np.radians(5.0), np.radians(-40.0), np.radians(20.0)))
    assert [slider.value for slider in knobs.sliders] == [10.0, 40.0, 30.0]
    knobs._release()
    shown.run(1.0, lambda: shown.pose(np.radians(5.0), np.radians(-40.0), np.radians(20.0)))
    assert [slider.value for slider in knobs.sliders] == [5.0, -40.0, 20.0]


def test_a_story_plays_on_a_simulated_device_and_is_told(shown):
    shown.begin()
    knobs, steered = shown.knobs, []
    knobs.player._steer = lambda *pose: steered.append(pose)
    shown.state('healthy')
    story = stories(4)[0]
    knobs._play(story, None)
    shown.run(1.0, shown.pose)
    assert shown.content['note'] == story.words
    shown.run(story.end, shown.pose)
    assert shown.content['note'] != story.words
    assert len(steered) == len(story.steps) + 1 and steered[-1] == ()


def test_the_state_of_the_force_feedback_is_a_figure(shown):
    shown.begin()
    shown.arm._on_force(String(data='fading: no hand on the handle'))
    shown.run(0.5)
    assert 'force: fading: no hand on the handle' in shown.figures
    # Words of another program are no state.
    shown.arm._on_force(String(data='strong'))
    shown.run(0.5)
    assert f'force: {readout.DASH}' in shown.figures
