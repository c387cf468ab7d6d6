# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The server of the page: its address, its light, and where its cameras are."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import redirect_stdout
import errno
from io import StringIO
import logging
import socket

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.view.access import guarded
from spm_haptic_master.view.scene import ARM_DISTANCE
from viser import ViserServer

# Last port of TCP.
LAST_PORT = 65535
# Light from everywhere (unit 1).
AMBIENT = 0.8
# Where the camera is from what it looks at in each view, for one device; that, for the first
# device (units of the scene); and by how much of it the camera backs off for each further device
# (unit 1).
CAMERAS = {'front': (1.15, -3.1, 1.85), 'side': (3.9, -0.01, 0.4), 'top': (0.0, -0.01, 4.1)}
LOOK_AT, BACK_OFF = (0.0, 0.0, 0.88), 0.75
# Field of view, from top to bottom (rad).
VIEW_ANGLE = 0.75


def serve(host: str, port: int, names: str = '',
          report: Callable[[str], None] = lambda _: None) -> ViserServer:
    """
    Return the server of the page at a host and a port, or the next free one.

    `names` are further names of the page; `report` is called, in the server's thread, with the
    reason of a refused request. InputError: the address cannot be used.
    """
    # Its log is of connections, to standard error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    port = free_port(host, port)
    # It prints its address in a frame; the first line of this program has it.
    with redirect_stdout(StringIO()), guarded(host, names, report):
        server = ViserServer(host=host, port=port, label='haptic master', verbose=False)
    server.gui.configure_theme(control_width='large', show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction('+z')
    # Shadows take most of the time where no GPU draws them.
    server.scene.configure_default_lights(cast_shadow=False)
    # So do reflections of surroundings that are not there.
    server.scene.configure_environment_map(hdri=None)
    server.scene.add_light_ambient('/ambient', intensity=AMBIENT)
    aim(server, 1)
    server.initial_camera.fov = VIEW_ANGLE
    return server


def free_port(host: str, first: int) -> int:
    """
    Return the first free port of an address; InputError where there is none, or no such address.

    viser would try one port after the other, for ever or beyond the last.
    """
    try:
        addresses = {(family, address) for family, *_, address in socket.getaddrinfo(
            host, None, type=socket.SOCK_STREAM)}
        for port in range(first, LAST_PORT + 1):
            try:
                for family, address in addresses:
                    with socket.socket(family, socket.SOCK_STREAM) as trial:
                        # As viser: a connection that has just ended does not keep the port.
                        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                        # Of IPv6, a scope is behind the port.
                        trial.bind((address[0], port, *address[2:]))
                        trial.listen()
                return port
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
    except OSError as error:
        raise InputError(f"parameter 'view.host' is {host!r}; expected an address of this host "
                         f'({error.strerror})') from error
    raise InputError(f"parameter 'view.port' is {first}; expected a port that is free, or has a "
                     'free one after it')


def views(arms: int) -> dict[str, tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the camera's position and target for each view of a number of devices in a row."""
    x, y, z = LOOK_AT
    x += 0.5 * ARM_DISTANCE * (arms - 1)
    back = 1.0 + BACK_OFF * (arms - 1)
    return {name: ((x + back * dx, y + back * dy, z + back * dz), (x, y, z))
            for name, (dx, dy, dz) in CAMERAS.items()}


def aim(server: ViserServer, arms: int) -> None:
    """Have the first picture of a page show a number of devices in a row."""
    place, target = views(arms)['front']
    server.initial_camera.look_at, server.initial_camera.position = target, place
