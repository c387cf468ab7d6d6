# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A hosted `teleop` with a test in the place of the master, the slave and the surgeon."""

from contextlib import contextmanager

from geometry_msgs.msg import PointStamped, PoseStamped, QuaternionStamped
from in_process import hosted
from mechanism import turn, zxz
import numpy as np
from sensor_msgs.msg import JointState, Joy
from spm_haptic_master.kinematics import matrix_from_quaternion, quaternion_from_matrix
from spm_haptic_master.nodes.teleop import Teleop
from std_msgs.msg import Float64MultiArray, String

# No limit changes a command, and there is one for each orientation.
UNLIMITED = {
    'rate': 100.0,
    'teleop.command_rate': 0.0,
    'teleop.acceleration_limit': 1e6,
    'teleop.presence_timeout': 0.0,
}
POSITION = (0.01, -0.02, 0.11)
PERIOD = 0.01


class Rig:
    """Gives a hosted node what a master, a slave and a surgeon publish."""

    def __init__(self, host):
        self.host = host
        self.commands = host.sent['servo_cp']
        self.twists = host.sent['delta_twist_cmds']
        self.master = zxz(0.3, 0.5, -0.2)
        self.slave = zxz(-1.0, 0.8, 0.4)
        self.sent = {}
        # Frame of the slave's pose, and whether its stamp goes on.
        self.frame = 'psm_base'
        self.slave_stamp = 1
        self.slave_goes_on = True
        # Position of the slave's tip (m); insertion of the master (m), its gripper and the slave's
        # jaw (rad); None: it has none.
        self.tip = POSITION
        self.insertion = self.gripper = self.jaw = None
        # Level that comes with each orientation (deg); None: none.
        self.level = None
        self.now = host.time_ns
        self.tell('healthy')
        self.press('presence', False)
        self.press('clutch', False)

    def press(self, pedal, pressed):
        self.host.give(pedal, Joy(buttons=[int(pressed)]))

    def tell(self, state):
        self.host.give('state', String(data=state))

    def orientation(self, when):
        message = QuaternionStamped()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(when, 10**9)
        q = message.quaternion
        q.x, q.y, q.z, q.w = quaternion_from_matrix(self.master).tolist()
        self.host.give('orientation', message)

    def give_joint(self, topic, name, position):
        if position is not None:
            message = JointState(name=[name], position=[float(position)])
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = divmod(self.now(), 10**9)
            self.host.give(topic, message)

    def give_trocar(self, position, frame=''):
        message = PointStamped()
        message.header.frame_id = frame
        message.point.x, message.point.y, message.point.z = map(float, position)
        self.host.give('slave/trocar', message)

    def run(self, count=10, turning=(0.0, 0.0, 0.0)):
        """Give poses of the slave and orientations, each turned since the last."""
        for _ in range(count):
            self.master = turn(turning) @ self.master
            pose = PoseStamped()
            pose.header.frame_id = self.frame
            pose.header.stamp.sec = self.slave_stamp
            self.slave_stamp += self.slave_goes_on
            pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = self.tip
            o = pose.pose.orientation
            o.x, o.y, o.z, o.w = quaternion_from_matrix(self.slave).tolist()
            self.host.give('slave/measured_cp', pose)
            self.give_joint('insertion/measured_js', 'insertion', self.insertion)
            self.give_joint('gripper/measured_js', 'gripper', self.gripper)
            self.give_joint('slave/jaw/measured_js', 'jaw', self.jaw)
            if self.level is not None:
                self.host.give('protection_level', Float64MultiArray(data=[self.level]))
            self.sent[self.now()] = self.master
            self.orientation(self.now())
            self.host.run(PERIOD)

    def engage(self):
        self.press('presence', True)
        self.run(20)
        answer = self.host.call('~/enable')
        self.run(20)
        assert self.state == 'engaged', answer

    def sends_nothing(self, **more):
        count = len(self.commands)
        self.run(20, **more)
        return len(self.commands) == count

    @property
    def tips(self):
        return np.array(
            [(p.x, p.y, p.z) for p in (message.pose.position for message in self.commands)]
        )

    @property
    def state(self):
        return self.host.last('teleop_state').data

    @property
    def matrices(self):
        return [
            matrix_from_quaternion([q.x, q.y, q.z, q.w])
            for q in (message.pose.orientation for message in self.commands)
        ]


@contextmanager
def running(**settings):
    """Yield the rig of a node with settings; in names, __ stands for a dot."""
    given = UNLIMITED | {name.replace('__', '.'): value for name, value in settings.items()}
    with hosted(
        Teleop, *(f'{name}:={value}' for name, value in given.items()), subscribes=True
    ) as host:
        host.run(0.02)
        yield Rig(host)
