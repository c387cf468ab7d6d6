# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors of a CAN bus: which exceptions python-can's interfaces raise, and their text."""

from __future__ import annotations

import errno
import sys

import can

# Exceptions that python-can's interfaces raise if a bus cannot be opened or used.
BUS_ERRORS = (can.CanError, OSError, ValueError, ImportError)


# Port of udp_multicast where none is configured, by python-can.
UDP_PORT = 43113
# Text of the error of python-can that means that msgpack is missing.
NO_MSGPACK = 'msgpack not installed'
# Remedies for errors of SocketCAN, by their number.
REMEDIES = {
    errno.EAFNOSUPPORT: 'this machine has no SocketCAN; give your bus, by --params-file rig.yaml '
    'or -p can.interface:=... -p can.channel:=...',
    errno.ENODEV: 'see `ip link`, and give your interface, by --params-file rig.yaml or '
    '-p can.channel:=...',
}


def bus_name(interface: str, channel: str) -> str:
    """Return interface and channel of a bus, and its port if it is between processes."""
    name = f'{interface} {channel}'
    if interface != 'udp_multicast':
        return name
    try:
        port = can.util.load_config(config={'interface': interface, 'channel': channel}).get(
            'port', UDP_PORT)
    except BUS_ERRORS:
        return name  # python-can's configuration is broken: opening the bus reports it
    return f'{name} port {port}'


def first_line(error: Exception) -> str:
    """
    Return the first line of an error's text, with a remedy if there is one.

    python-can's texts may contain a traceback.
    """
    line = (str(error) or type(error).__name__).splitlines()[0]
    if line == NO_MSGPACK:
        if sys.prefix == sys.base_prefix:
            return f'{line}: sudo apt install python3-msgpack'
        # A virtual environment, such as that of `make run`.
        return f'{line}: {sys.prefix}/bin/python -m pip install msgpack'
    remedy = REMEDIES.get(getattr(error, 'errno', None) or getattr(error, 'error_code', None) or 0)
    return f'{line}: {remedy}' if remedy else line
