# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the four encoders, and their frames, as the tests of the encoders need them."""

from __future__ import annotations

from functools import cache

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.decoder_factory import make_decoder, make_layouts
from spm_haptic_master.parameters.encoders import extended, for_sensors
from spm_haptic_master.parameters.files import simulated_rig, source_defaults
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.setting import complete

PERIOD = 1e-3
# s; when the streams of these tests begin.
T0 = 1_760_000_000.0


@cache
def _defaults(source, sensors):
    """Return the settings of a source, and their defaults, calibrated; files are read once."""
    settings = for_sensors(SOURCE_SETTINGS[source], sensors)
    known = {setting.name for setting in settings}
    found = extended(source_defaults(source), settings) | simulated_rig(sensors)
    return settings, {name: value for name, value in found.items() if name in known}


def values(source='can', **overrides):
    """Return the checked settings of a source, calibrated; in names, __ stands for a dot."""
    settings, defaults = _defaults(source, overrides.get('sensors', 4))
    return complete(
        settings, defaults | {name.replace('__', '.'): value for name, value in overrides.items()}
    )


def decoder(**overrides):
    """Return the decoder of config/can.yaml."""
    return make_decoder(values(**overrides))


LAYOUTS = make_layouts(values())


def sync(at, counter=None):
    """Return SYNC at a time in s."""
    return canopen.frame(0x80, b'' if counter is None else bytes((counter,)), at)


def answer(index, at, angle=0.1, layouts=LAYOUTS, **fields):
    """Return an encoder's frame; `fields` replace what a Message takes."""
    layout = layouts[index]
    taken = {
        'arbitration_id': layout.can_id,
        'is_extended_id': layout.extended,
        'data': layout.data(angle),
        'timestamp': at,
        **fields,
    }
    return can.Message(**taken)


def cycle(number, angles=(0.1, 0.2, 0.3, 0.4), layouts=LAYOUTS):
    """Return SYNC and four answers of a cycle."""
    at = T0 + number * PERIOD
    return [
        sync(at),
        *(
            answer(index, at + 1.5e-4 * (index + 1), angle, layouts)
            for index, angle in enumerate(angles)
        ),
    ]


def stream(*numbers):
    """Return the frames of cycles."""
    return [message for number in numbers for message in cycle(number)]


def record(path, messages):
    """Write a log with python-can's own writer; return its path."""
    with can.Logger(str(path)) as logger:
        for message in messages:
            logger(message)
    return path


def feed(taker, messages):
    """Return the sets that frames complete."""
    return [sample for message in messages if (sample := taker.feed(message)) is not None]
