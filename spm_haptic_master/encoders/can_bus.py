# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A CAN bus of python-can: how it is opened and named, its errors in words, its times.

Interfaces differ in their errors and clocks; the rest of the room sees one form of both.
"""

from __future__ import annotations

import configparser
from contextlib import suppress
import errno
import json
import logging
import os
from pathlib import Path
from typing import Any

import can
from spm_haptic_master.exceptions import InputError, quoted, SettingError

# Exceptions that python-can's interfaces raise if a bus cannot be opened or used.
BUS_ERRORS = (can.CanError, OSError, ValueError, ImportError)

# Environment variable with further settings of a bus, by python-can.
CONFIG_VARIABLE = 'CAN_CONFIG'
# Port of udp_multicast where none is configured, by python-can.
UDP_PORT = 43113
# Remedies, by the text of python-can's error, and for errors of SocketCAN by their number.
REMEDIES = {
    'msgpack not installed': 'sudo apt install python3-msgpack; in a virtual environment: '
    'pip install msgpack',
    errno.EAFNOSUPPORT: 'this machine has no SocketCAN; give your bus, by --params-file rig.yaml '
    'or -p can.interface:=... -p can.channel:=...',
    errno.ENODEV: 'see `ip link`, and give your interface, by --params-file rig.yaml or '
    '-p can.channel:=...',
}
# Error classes: bits of an error frame's identifier, by Linux's linux/can/error.h, which
# python-can passes on unchanged; and their words.
CONTROLLER = 0x004
BUS_OFF = 0x040
RESTARTED = 0x100
CLASS_WORDS = {
    0x001: 'transmit timeout',
    0x002: 'lost arbitration',
    CONTROLLER: 'controller problem',
    0x008: 'protocol violation',
    0x010: 'transceiver',
    0x020: 'no acknowledge (is any other node on the bus?)',
    BUS_OFF: 'bus-off',
    0x080: 'bus error',
    RESTARTED: 'controller restarted',
}
# Words for the bits of data byte 1 of a controller problem.
CONTROLLER_WORDS = {
    0x01: 'receive overflow',
    0x02: 'transmit overflow',
    0x04: 'receive warning level',
    0x08: 'transmit warning level',
    0x10: 'receive error passive',
    0x20: 'transmit error passive',
    0x40: 'error active again',
}
# Difference between receive time and this machine's clock (s) beyond which the device has an epoch
# of its own, such as its start: no frame waits a day in a queue.
OWN_EPOCH = 86400.0
# Step back of a device's clock (s) that no delay explains: it wrapped, or the device restarted.
STEP_BACK = 1.0
# Span for which the least delay is collected (s). The offset is the least of this span and the one
# before; at a crystal's drift of 50 ppm it is wrong by 0.1 ms at most.
SPAN = 1.0


def bus_name(interface: str, channel: str) -> str:
    """
    Return the name of a bus, for texts.

    Parameters
    ----------
    interface, channel : str
        Names by python-can.

    Returns
    -------
    str
        Such as 'socketcan can0'; with its port if the bus is between processes (udp_multicast).

    """
    name = f'{interface} {channel}'
    if interface == 'udp_multicast':
        # Where python-can's configuration is broken, opening the bus reports it.
        with suppress(*BUS_ERRORS):
            config = can.util.load_config(config={'interface': interface, 'channel': channel})
            return f'{name} port {config.get("port", UDP_PORT)}'
    return name


def first_line(error: Exception) -> str:
    """
    Return the first line of an error's text, which may contain a traceback.

    Parameters
    ----------
    error : Exception
        One of BUS_ERRORS, usually.

    Returns
    -------
    str
        One line, with a remedy if there is one.

    """
    line = (str(error) or type(error).__name__).splitlines()[0]
    number = getattr(error, 'errno', None) or getattr(error, 'error_code', None)
    remedy = REMEDIES.get(number or line)
    return f'{line}: {remedy}' if remedy else line


def error_words(message: can.Message) -> str:
    """
    Return the errors that an error frame reports, in words.

    Parameters
    ----------
    message : can.Message
        Error frame with the error classes of Linux's linux/can/error.h in its identifier.

    """
    identifier = message.arbitration_id
    data = message.data
    words = [word for bit, word in CLASS_WORDS.items() if identifier & bit]
    if identifier & CONTROLLER and len(data) > 1:
        words += [word for bit, word in CONTROLLER_WORDS.items() if data[1] & bit]
    return ', '.join(words) or f'unknown error 0x{identifier:X}'


def check_configuration() -> None:
    """
    Refuse a configuration of python-can that cannot be read.

    python-can merges its files and the variable CAN_CONFIG into the settings of every bus.

    Raises
    ------
    InputError
        A file or the variable cannot be read; the text names it.

    """
    for name in can.util.CONFIG_FILES:
        path = Path(name).expanduser()
        if not path.is_file():
            continue
        try:
            can.util.load_file_config(path)
        except (configparser.Error, OSError, ValueError) as error:
            reason = ' '.join(str(error).split())[:200]
            raise InputError(
                f"{path}: not a configuration file of python-can ({reason}); expected '[default]' "
                "and lines 'NAME = VALUE', each name once"
            ) from error
    text = os.environ.get(CONFIG_VARIABLE, '{}')
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        value = error
    if not isinstance(value, dict):
        raise InputError(
            f'environment variable {CONFIG_VARIABLE} is {quoted(text)}; expected a JSON object '
            'such as \'{"port": 43114}\''
        )


def check_interface(interface: str, name: str = 'can.interface') -> None:
    """
    Refuse an interface that python-can does not have.

    Parameters
    ----------
    interface : str
        Name by python-can.
    name : str
        Name of the setting, for the error.

    Raises
    ------
    SettingError
        There is no such interface.
    InputError
        As of `check_configuration`.

    """
    check_configuration()
    if interface not in can.VALID_INTERFACES:
        raise SettingError(
            name=name,
            value=interface,
            expected='one of ' + ', '.join(sorted(can.VALID_INTERFACES)),
        )


def open_bus(
    interface: str,
    channel: str,
    bitrate: int,
    own: bool = False,
) -> can.BusABC:
    """
    Open a bus.

    python-can reads further settings of an interface from its configuration files and from
    CAN_CONFIG.

    Parameters
    ----------
    interface, channel : str
        Names by python-can: 'socketcan' and 'can0' on a rig.
    bitrate : int
        Bit rate, bit/s, for interfaces that set it themselves; 0 leaves it to the system.
    own : bool
        Whether the bus also returns the frames sent here, if it can.

    Returns
    -------
    can.BusABC
        Open bus; `shutdown` closes it.

    Raises
    ------
    can.CanError
        It cannot be opened; python-can raises one of BUS_ERRORS.

    """
    # python-can logs the errors that it raises.
    logging.getLogger('can').setLevel(logging.CRITICAL)
    settings: dict[str, Any] = {'interface': interface, 'channel': channel}
    if bitrate:
        settings['bitrate'] = bitrate
    if own:
        with suppress(NotImplementedError, TypeError):  # not supported; opened without below
            return can.Bus(**settings, receive_own_messages=True)
    return can.Bus(**settings)


class ReceiveClock:
    """
    Maps an interface's receive times to the Unix epoch.

    The kernel's times already have this epoch. Times of a device that counts from its own start
    are shifted by the least difference between arrival and receive time: the frame with the least
    delay. Without receive times, the times of arrival are used.
    """

    def __init__(self) -> None:
        # Start of the span, s since the Unix epoch; set with the first offset.
        self._span_began: float
        # Latest receive time by a device's own clock, s.
        self._received = float('-inf')
        self._least = self._least_before = float('inf')

    def epoch(self, received: float, arrived: float) -> float:
        """
        Map a receive time to the Unix epoch.

        Parameters
        ----------
        received : float
            Receive time by the interface, s; 0 if it has none.
        arrived : float
            Time at which the frame was read here, s since the Unix epoch.

        Returns
        -------
        float
            Time of reception, s since the Unix epoch.

        """
        if not received:
            return arrived
        delay = arrived - received
        if abs(delay) < OWN_EPOCH:
            return received
        stepped_back = received < self._received - STEP_BACK
        self._received = received
        if stepped_back or abs(delay - self._least) > OWN_EPOCH:  # the first, or another clock
            self._least = self._least_before = delay
            self._span_began = arrived
        elif not 0.0 <= arrived - self._span_began < SPAN:
            self._least_before = self._least
            self._least = delay
            self._span_began = arrived
        elif delay < self._least:
            self._least = delay
        return received + min(self._least, self._least_before)
