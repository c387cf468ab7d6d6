# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sentence that says which encoders determine the pose, and which check one another."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees

from spm_haptic_master.kinematics.joints import NUMBER_WORDS
from spm_haptic_master.view.names import SENSOR_NAMES
from spm_haptic_master.view.seen import Seen
from spm_haptic_master.view.status import SensorState

# Error of three encoders clear of the singularity that noise does not explain (deg).
WRONG_SIDE = 3.0
# States of a sensor that the orientation is computed without.
LOST = SensorState.MISSING, SensorState.EXCLUDED
# Text of a figure without a value.
DASH = '\u2013'


@dataclass(frozen=True, slots=True)
class Sentence:
    """A sentence, and whether it is a warning."""

    text: str
    warns: bool


def sentence(seen: Seen, warn_below: float) -> Sentence:
    """
    Return the sentence of a device; `warn_below` is a dexterity, nan if it is not known.

    Parameters
    ----------
    seen : Seen
        What is known of the device.
    warn_below : float
        Dexterity below which a pose is near a singularity (unit 1).

    Returns
    -------
    Sentence
        A dash while the dexterities or their limit are not known.

    """
    if seen.orientation is None:
        return Sentence('No orientation: the picture is not the present pose.', True)
    if seen.dexterities is None or warn_below != warn_below:
        return Sentence(DASH, False)
    three, every = seen.dexterities
    if every < warn_below:
        return Sentence(f'Not even {_number_in_use(seen)} encoders determine this pose.', True)
    if not three >= warn_below:
        return Sentence(_at_singularity(seen), True)
    if seen.ghost is not None and degrees(seen.ghost) > WRONG_SIDE:
        return Sentence(
            f'Three encoders alone are {degrees(seen.ghost):.0f}\u00b0 wrong: they left the '
            'singularity on its wrong side. The device did not.',
            True,
        )
    return Sentence(f'Three encoders determine this pose. {_check(seen)}'.strip(), False)


def _number_in_use(seen: Seen) -> str:
    """Return the number of encoders in use, in words."""
    lost = sum(state in LOST for state in seen.states)
    return NUMBER_WORDS.get(seen.settings.sensors - lost, 'three')


def _at_singularity(seen: Seen) -> str:
    """Return the sentence at the singularity, with the encoders that nobody checks there."""
    words = (
        'Singularity: three motor encoders do not determine this pose; '
        f'{_number_in_use(seen)} encoders do.'
    )
    unchecked = _named(seen, SensorState.UNCHECKED)
    return f'{words} {_unchecked(unchecked)}' if unchecked else words


def _check(seen: Seen) -> str:
    """Return which encoders check one another: what the chips show, in words."""
    unchecked = _named(seen, SensorState.UNCHECKED)
    if unchecked:
        return _unchecked(unchecked)
    number = _number_in_use(seen)
    used = [state for state in seen.states if state not in LOST]
    if number == 'three' or not used or SensorState.UNKNOWN in used:
        return ''
    return f'With {number} they check one another.'


def _unchecked(names: list[str]) -> str:
    """Return the sentence of sensors that the others do not check."""
    verb = 'is' if len(names) == 1 else 'are'
    return f'{", ".join(names)} {verb} not checked by the others here.'


def _named(seen: Seen, state: SensorState) -> list[str]:
    """Return the names of the sensors in a state."""
    return [name for name, other in zip(SENSOR_NAMES, seen.states, strict=False) if other is state]
