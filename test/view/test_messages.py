# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""No message of another program ends `view`, whatever the lengths of its fields are."""

from functools import partial
from math import inf, nan

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import QuaternionStamped, WrenchStamped
import numpy as np
import pytest
from rcl_interfaces.msg import ParameterValue
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, MECHANISM_JOINT_NAMES
from spm_haptic_master.view import messages
from std_msgs.msg import Float64MultiArray, String

# Names that a message may have, in any number and order, and texts of words.
NAMES = [*MECHANISM_JOINT_NAMES, *ALL_JOINT_NAMES, '', 'joint_4', 'left/joint_1a']
TEXTS = [
    '',
    '{}',
    '[1]',
    'healthy',
    'silent: ',
    'degraded: joint_1b missing',
    'sim',
    'stuck:joint_9',
    '{"covered": 3}',
    '{"covered": {"a": "b"}}',
    '{"covered": {"a": 1e999, "b": NaN}, "text": []}',
    '{"covered": {"a": ' + '9' * 400 + '}}',
    '[' * 5000,
    '\u2028</script>\'"',
]
NUMBERS = [0.0, 1.0, -1e308, 1e-320, inf, -inf, nan]
# Draws of each kind of message.
DRAWS = 60


def lists(
    rng,
    values,
    lengths=(0, 1, 2, 4, 6, 9, 12, 40),
):
    """Return a list of one of these lengths."""
    return [values[k] for k in rng.integers(0, len(values), rng.choice(lengths))]


def joint_state(rng):
    """Return joints of any names, and of any number of positions."""
    names = [
        list(MECHANISM_JOINT_NAMES),
        list(ALL_JOINT_NAMES[:4]),
        list(ALL_JOINT_NAMES),
        lists(rng, NAMES),
    ][rng.integers(4)]
    message = JointState(name=names, position=lists(rng, NUMBERS))
    message.velocity = lists(rng, NUMBERS)
    message.header.stamp.sec = int(rng.integers(-(2**31), 2**31))
    message.header.stamp.nanosec = int(rng.integers(0, 2**32))
    return message


def array(rng):
    return Float64MultiArray(data=lists(rng, NUMBERS))


def words(rng):
    return String(data=TEXTS[rng.integers(len(TEXTS))])


def wrench(rng):
    message = WrenchStamped()
    torque = message.wrench.torque
    torque.x, torque.y, torque.z = (NUMBERS[k] for k in rng.integers(0, len(NUMBERS), 3))
    return message


def quaternion(rng):
    message = QuaternionStamped()
    turn = [NUMBERS[k] for k in rng.integers(0, len(NUMBERS), 4)]
    part = message.quaternion
    part.x, part.y, part.z, part.w = turn
    return message


def status(rng):
    """Return an entry of /diagnostics, of the device's own names, with any values."""
    names = 'fkm: orientation', 'diagnostics: singularity', 'encoder_driver: encoders', '', '/'
    keys = ['protection level (deg)', 'warn below', 'joints missing', 'joint_1b unchecked (s)', '']
    return DiagnosticStatus(
        level=bytes([int(rng.integers(4))]),
        name=names[rng.integers(len(names))],
        message=TEXTS[rng.integers(len(TEXTS))],
        values=[
            KeyValue(key=key, value=['', 'nan', 'inf', 'x', '0.5'][rng.integers(5)])
            for key in lists(rng, keys)
        ],
    )


WORDS = 'state', 'source', 'force_state', 'teleop_state', 'operating_state_text'
SAMPLED = {
    'dexterity': array,
    'readings': joint_state,
    'body/servo_cf': wrench,
    'body/measured_cf': wrench,
    'insertion/measured_js': joint_state,
    'gripper/measured_js': joint_state,
    'ground_truth/orientation': quaternion,
}
KINDS = [
    'joint_states',
    *WORDS,
    'calibration/coverage',
    'simulation/faults',
    *SAMPLED,
    '/diagnostics',
    'fkm/get_parameters',
]


@pytest.mark.parametrize('kind', KINDS)
def test_no_message_of_any_length_ends_view(shown, kind):
    """A legal JointState with nine names and fewer positions did."""
    rng = np.random.default_rng(KINDS.index(kind))
    shown.begin(source='sim')
    shown.publishers = {
        f'/{name}/measured_js': ['encoder_driver'] for name in ('insertion', 'gripper')
    }
    shown.operate('cross the singularity')
    shown.run(0.5, shown.fkm)
    for _ in range(DRAWS):
        if kind == '/diagnostics':
            for entry in DiagnosticArray(status=[status(rng) for _ in range(3)]).status:
                shown.arm.on_diagnostics(entry)
        elif kind == 'fkm/get_parameters':
            answers = [ParameterValue(type=int(rng.integers(10))) for _ in range(rng.integers(9))]
            shown.answer(answers)
        elif kind in SAMPLED:
            shown.newest[f'/{kind}'] = SAMPLED[kind](rng)
        else:
            if kind == 'joint_states':
                message = joint_state(rng)
            else:
                message = words(rng)
            shown.takers[f'/{kind}'](message)
        shown.run(0.3, period=0.1)
    # It shows a healthy device afterwards.
    shown.say('state', 'healthy')
    shown.run(4.0, partial(shown.fkm, caution='none'))
    assert shown.text == 'healthy'


def test_nine_names_need_nine_positions():
    message = JointState(name=MECHANISM_JOINT_NAMES, position=[0.1] * 9)
    assert messages.mechanism_joints(message).angles == (0.1,) * 9
    for count in (0, 1, 8, 10):
        message = JointState(name=MECHANISM_JOINT_NAMES, position=[0.1] * count)
        assert messages.mechanism_joints(message) is None
        assert messages.readings(JointState(name=ALL_JOINT_NAMES[:4], position=[0.0] * 3)) is None
