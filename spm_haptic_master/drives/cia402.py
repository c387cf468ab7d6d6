# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The profile of drives, CiA 402: objects, states, and the controlword of each next transition.

Constants and pure functions only: no frames are sent here.
"""

from __future__ import annotations

from enum import Enum

from spm_haptic_master.encoders import canopen

# Objects: index and subindex. Of CiA 301: heartbeat that is expected (node id and ms), and what
# the loss of it does.
HEARTBEAT_CONSUMER = (0x1016, 1)
ERROR_BEHAVIOUR = (0x1029, 1)
ABORT_OPTION = (0x6007, 0)
CONTROLWORD = (0x6040, 0)
STATUSWORD = (0x6041, 0)
QUICK_STOP_OPTION = (0x605A, 0)
FAULT_OPTION = (0x605E, 0)
MODE = (0x6060, 0)
MODE_DISPLAY = (0x6061, 0)
TARGET_TORQUE = (0x6071, 0)
MAXIMUM_TORQUE = (0x6072, 0)
RATED_TORQUE = (0x6076, 0)
TORQUE_ACTUAL = (0x6077, 0)
POLARITY = (0x607E, 0)
MAXIMUM_MOTOR_SPEED = (0x6080, 0)
PERIOD_VALUE = (0x60C2, 1)
PERIOD_EXPONENT = (0x60C2, 2)
SUPPORTED_MODES = (0x6502, 0)

# Abort connection option: disable voltage. Not quick stop: its ramp is a velocity controller,
# which works against the hand.
DISABLE_VOLTAGE_ON_ABORT = 2
# Quick stop and fault reaction option: disable the drive function, the motor is free.
FREE = 0

# Modes of operation: cyclic synchronous torque, profile torque.
CYCLIC_TORQUE = 10
PROFILE_TORQUE = 4
# A torque of 1 in the unit of 6071h and 6077h: per mille of the rated torque.
PER_MILLE = 1000
# Largest torque that an INTEGER16 holds (per mille).
LARGEST = 32767


class State(Enum):
    """
    State of a drive's finite state automaton, in the words of CiA 402.

    UNKNOWN is a statusword that no state of the profile has.
    """

    NOT_READY = 'Not ready to switch on'
    DISABLED = 'Switch on disabled'
    READY = 'Ready to switch on'
    SWITCHED_ON = 'Switched on'
    ENABLED = 'Operation enabled'
    QUICK_STOP = 'Quick stop active'
    REACTING = 'Fault reaction active'
    FAULT = 'Fault'
    UNKNOWN = 'not a state of CiA 402'


# Mask and value of the statusword in each state.
PATTERNS = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.DISABLED),
    (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.ENABLED),
    (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.REACTING),
    (0x4F, 0x08, State.FAULT),
)

# Commands of the controlword.
DISABLE_VOLTAGE = 0x00
SHUTDOWN = 0x06
SWITCH_ON = 0x07
ENABLE_OPERATION = 0x0F
FAULT_RESET = 0x80
# Controlword of the next transition towards Operation enabled; any other state gets disable
# voltage. From a fault only a reset leads on, which only an acknowledgement causes.
ONWARDS = {
    State.DISABLED: SHUTDOWN,
    State.READY: SWITCH_ON,
    State.SWITCHED_ON: ENABLE_OPERATION,
    State.ENABLED: ENABLE_OPERATION,
}


def state_of(statusword: int) -> State:
    """
    Return the state that a statusword reports.

    Parameters
    ----------
    statusword : int
        Value of 6041h, 16 bits.

    Returns
    -------
    State
        UNKNOWN if no pattern of CiA 402 fits.

    """
    return next(
        (state for mask, value, state in PATTERNS if statusword & mask == value), State.UNKNOWN
    )


def controlword(state: State, operate: bool) -> int:
    """
    Return the command of the next transition.

    Parameters
    ----------
    state : State
        State that the drive reports.
    operate : bool
        Whether the goal is Operation enabled; otherwise voltage is disabled at once.

    Returns
    -------
    int
        Value for 6040h. It never resets a fault: only an acknowledgement does.

    """
    if operate:
        return ONWARDS.get(state, DISABLE_VOLTAGE)
    return DISABLE_VOLTAGE


def mode_words(mode: int) -> str:
    """
    Return a mode of operation (6060h) in words, for error texts.

    Parameters
    ----------
    mode : int
        Value of 6060h or 6061h.

    Returns
    -------
    str
        Its name with its number, such as 'profile torque (4)'.

    """
    return {CYCLIC_TORQUE: 'cyclic synchronous torque', PROFILE_TORQUE: 'profile torque'}.get(
        mode, 'another mode'
    ) + f' ({mode})'


# Error codes of EMCY: those of CiA 301, and some of CiA 402.
ERROR_WORDS = canopen.EMCY_CODES | {
    0x2310: 'continuous over current',
    0x2320: 'short circuit',
    0x2350: 'I2t, load level fault',
    0x3210: 'DC link over-voltage',
    0x3220: 'DC link under-voltage',
    0x4210: 'excess temperature of the device',
    0x4310: 'excess temperature of the drive',
    0x7121: 'motor blocked',
    0x7300: 'sensor',
    0x7305: 'incremental sensor 1 fault',
    0x8400: 'velocity speed controller',
    0x8611: 'following error',
}
