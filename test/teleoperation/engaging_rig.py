# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A tele-operation with a test in the place of master, slave and surgeon; times are in ms."""

from math import radians

from mechanism import turn, zxz
import numpy as np
from spm_haptic_master.kinematics import matrix_from_quaternion, quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import vector_from_quaternion
from spm_haptic_master.nodes.teleop_factory import make_teleoperation
from spm_haptic_master.parameters.nodes import TELEOP_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.orientation_state import read_state
from spm_haptic_master.teleoperation.command import Pose

# Sample period of the master (ms, ns).
MS = 1_000_000
# Orientations of the master and the slave at the start.
MASTER = zxz(0.3, 0.5, -0.2)
SLAVE = zxz(-1.0, 0.8, 0.4)
# Command period of the defaults (s).
PERIOD = 0.005


def quaternion(matrix):
    return tuple(quaternion_from_matrix(matrix).tolist())


def rotation_vector(matrix):
    return np.array(vector_from_quaternion(*quaternion(matrix)))


def angle_between(one, other):
    return np.linalg.norm(rotation_vector(other @ one.T))


class Rig:
    """A machine, its master and its slave, which passes time by samples of the master."""

    def __init__(self, **parameters):
        # Presence is not repeated here, but where a test says so.
        values = complete(
            TELEOP_SETTINGS,
            {'teleop.presence_timeout': 0.0}
            | {
                f'teleop.{name}' if name != 'rate' else name: value
                for name, value in parameters.items()
            },
        )
        self.machine = make_teleoperation(values)
        self.stamp = 1_700_000_000_000 * MS
        self.master = MASTER
        self.slave = SLAVE
        self.master_speaks = self.slave_speaks = True
        # Protection level that each sample has, deg; None: none.
        self.level = None
        self.commands = []
        # The last command whole, and the commanded positions of all, m.
        self.last = None
        self.tips = []
        # Position of the slave's tip, m, and insertion of the master, m; None: it has none.
        self.tip = (0.0, 0.0, 0.0)
        self.insertion = None
        # The rotations of slave and master that came last, and their quaternions.
        self.spoken = {'master': (None, None), 'slave': (None, None)}

    def run(self, steps, turning=(0.0, 0.0, 0.0)):
        """Run for some ms, the master turning at a rate, rad/s; return the commands."""
        given = []
        for _ in range(steps):
            self.stamp += MS
            if np.any(turning):
                self.master = turn(0.001 * np.asarray(turning)) @ self.master
            self.machine.pass_time(0.001)
            if self.level is not None:
                self.machine.take_level(radians(self.level))
            if self.insertion is not None:
                self.machine.take_insertion(self.insertion)
            if self.slave_speaks:
                self.machine.take_slave(Pose(self.speak('slave', self.slave), self.tip))
            if self.master_speaks:
                command = self.machine.take_master(self.stamp, self.speak('master', self.master))
                if command is not None:
                    given.append((self.stamp, matrix_from_quaternion(command.pose.rotation)))
                    self.last = command
                    self.tips.append(command.pose.position)
        self.commands += given
        return given

    def speak(self, who, matrix):
        if matrix is not self.spoken[who][0]:
            self.spoken[who] = matrix, quaternion(matrix)
        return self.spoken[who][1]

    def pause(self, who, steps):
        """Have master or slave say nothing for some ms."""
        setattr(self, f'{who}_speaks', False)
        given = self.run(steps)
        setattr(self, f'{who}_speaks', True)
        return given

    def ready(self):
        """Meet every condition but presence and enable."""
        self.machine.take_state(read_state('healthy'))
        self.run(60)  # the slave has to be at rest for a moment
        return self

    def engage(self):
        """Engage; the enable comes before the presence."""
        assert self.ready().machine.enable() == ''
        assert self.run(10) == []
        self.machine.take_presence(True)
        assert self.run(100)
        assert self.state == 'engaged'
        return self

    @property
    def state(self):
        return self.machine.state
