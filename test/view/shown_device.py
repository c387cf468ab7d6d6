# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device on a real page, with topics and a clock of the test's own."""

from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
import numpy as np
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.joints import JOINT_NAMES, MECHANISM_JOINT_NAMES
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.view.arm import Arm
from spm_haptic_master.view.page import Page
from spm_haptic_master.view.settings_client import SETTINGS
from spm_haptic_master.view.status_entries import StatusEntries
from std_msgs.msg import String

GEOMETRY = kinematics.Geometry()
# Time between two ticks (s).
TICK = 0.05


def entry_of(
    name,
    message='',
    level=DiagnosticStatus.OK,
    values=(),
):
    """Return an entry of /diagnostics."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        values=[KeyValue(key=key, value=value) for key, value in dict(values).items()],
    )


def entries_of(entries, now=1.0):
    """Return entries that came at 1 s, by name: level, message and values."""
    made = StatusEntries('')
    for name, (level, message, values) in entries.items():
        made.add(entry_of(name, message, level, values), 1.0)
    made.now = now
    return made


def turn_of(handle):
    """Return the rotation matrix of a node of the scene."""
    return kinematics.matrix_from_quaternion(np.roll(handle.wxyz, -1))


def sampled(
    node,
    kind,
    topic,
):
    """Return a topic of which the newest message is the test's."""
    return SimpleNamespace(
        subscribe=lambda: node.sampled.add(topic),
        unsubscribe=lambda: node.sampled.discard(topic),
        take=lambda: node.newest.pop(topic, None),
    )


class Shown:
    """A device on a real page, and the node that it has."""

    def __init__(self, server):
        self.server = server
        self.now = 1000.0
        self.watched = True
        self.takers = {}
        self.newest = {}
        self.sampled = set()
        self.published = []
        # Parameters of fkm, when it was asked for them; whether a calibration runs.
        self.parameters = {}
        self.asked = []
        self.calibrates = True
        # Nodes that publish, by topic; whether the device's own programs run.
        self.publishers = {}
        self.runs = True
        self._samples = 0

    def create_subscription(
        self,
        kind,
        topic,
        take,
        qos,
    ):
        self.takers[topic] = take
        return topic

    def destroy_subscription(self, topic):
        del self.takers[topic]

    def destroy_client(self, client):
        self.parameters = None

    def destroy_publisher(self, publisher):
        pass

    def create_publisher(
        self,
        kind,
        topic,
        qos,
    ):
        return SimpleNamespace(
            publish=lambda sent: self.published.append(
                (topic.removeprefix('/'), getattr(sent.data, 'tolist', lambda: sent.data)())
            )
        )

    def create_client(self, kind, name):
        return SimpleNamespace(
            service_is_ready=lambda: self.parameters is not None, call_async=self._ask
        )

    def _ask(self, request):
        """Answer a request for parameters as fkm does."""
        self.asked.append(self.now)
        values = complete(SETTINGS, self.parameters)
        answers = []
        for name in request.names:
            value = values[name]
            if isinstance(value, tuple):
                value = list(value)
            else:
                value = value
            answers.append(Parameter(name, value=value).get_parameter_value())
        future = SimpleNamespace(result=lambda: SimpleNamespace(values=answers))
        return SimpleNamespace(add_done_callback=lambda take: take(future))

    def answer(self, values):
        """Have the service of parameters answer with these values."""
        answered = SimpleNamespace(values=values)
        self.arm._client._on_answer(SimpleNamespace(result=lambda: answered))

    def count_publishers(self, topic):
        return int(self.calibrates if topic == f'/{COVERAGE_TOPIC}' else self.runs)

    def get_publishers_info_by_topic(self, topic):
        return [SimpleNamespace(node_name=name) for name in self.publishers.get(topic, ())]

    def begin(self, state='healthy', source='', **parameters):
        """Show the device with parameters of its fkm, in a state."""
        self.parameters = parameters
        self.arm = Arm(self, self, Page(self.server), '/')
        self.arm.stand(0)
        self.arm.tick(self.now)
        self.say('state', state)
        if source:
            self.say('source', source)
        return self

    def say(self, topic, text):
        self.takers[f'/{topic}'](String(data=text))

    def pose(
        self,
        tilt=0.1,
        azimuth=0.0,
        phi=0.6,
        again=False,
    ):
        """Have new joint angles of a pose, rad; return its matrix."""
        R = kinematics.workspace_pose(tilt, azimuth, phi)
        self._samples += not again
        message = JointState(
            name=list(MECHANISM_JOINT_NAMES),
            position=kinematics.mechanism_angles(tuple(R.ravel()), GEOMETRY),
        )
        message.header.stamp.sec = self._samples
        self.takers['/joint_states'](message)
        return R

    def readings(self, pose, off):
        """Have four encoders read the next pose, off by angles, rad; return its angles."""
        R = kinematics.workspace_pose(*pose)
        angles = np.array(kinematics.mechanism_angles(tuple(R.ravel()), GEOMETRY))[[0, 3, 6, 2]]
        message = JointState(name=list(JOINT_NAMES), position=angles + off)
        message.header.stamp.sec = self._samples
        message.header.stamp.nanosec = 999_999_999
        self.newest['/readings'] = message
        return angles

    def torques(self, **sizes):
        """Have torques, N m about y, by the names of their topics."""
        for name, size in sizes.items():
            message = WrenchStamped()
            message.wrench.torque.y = size
            self.newest[f'/body/{name}_cf'] = message

    def entry(
        self,
        name,
        message='',
        level=DiagnosticStatus.OK,
        **values,
    ):
        """Have an entry on /diagnostics."""
        self.arm.on_diagnostics(entry_of(name, message, level, values))

    def fkm(self, **values):
        """Have a pose and an entry of a healthy fkm."""
        self.pose()
        self.entry('fkm: orientation', 'healthy', **{'protection level (deg)': '0.5', **values})

    def run(
        self,
        seconds,
        each=lambda: None,
        period=TICK,
    ):
        """Let time pass, with something before each tick."""
        for _ in range(round(seconds / period)):
            self.now += period
            each()
            self.arm.tick(self.now)

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
        return next(
            each
            for each in self.server.gui._gui_input_handle_from_uuid.values()
            if each.label == label
        )

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
        return {row['name']: row['text'] for row in self.content.get('rows', ())}

    @property
    def note(self):
        """Return the sentence of the device."""
        return self.content['note']['text']

    @property
    def chips(self):
        return [chip['text'] for chip in self.content['chips']]
