# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The file of a passed force_check: of which drives, with which directions and gears.

A motor with the wrong sign, two motors that are swapped, or a wrong rated torque make the device
run away from a touch, and no sample shows it before. So only drives get torque that a check has
passed, and only as they were then.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
import json
from math import isclose
from pathlib import Path
from typing import Any

from spm_haptic_master.drives.plan import DrivePlan
from spm_haptic_master.exceptions import InputError, quoted

# What the file is, in it and in errors.
KIND = 'passed force_check'
# Largest difference of two values that are the same (share of them).
SAME = 1e-6


@dataclass(frozen=True, slots=True)
class Identity:
    """
    What a drive reports of itself; None for an object that it does not have.

    Attributes
    ----------
    vendor, product, serial : int or None
        Vendor id, product code, serial number (1018h).
    polarity : int or None
        Polarity (607Eh): a drive may turn its commands around by it.

    """

    vendor: int | None = None
    product: int | None = None
    serial: int | None = None
    polarity: int | None = None

    @property
    def words(self) -> str:
        """Return it in words."""
        return ', '.join(
            f'{name} {"none" if number is None else f"0x{number:X}"}'
            for name, number in asdict(self).items()
        )


@dataclass(frozen=True, slots=True)
class CheckedDrive:
    """
    One drive as it was checked.

    Attributes
    ----------
    joint : str
        Joint of its motor.
    node_id : int
        CANopen node id.
    identity : Identity
        Identity that the drive reports.
    direction : int
        Sign of the motor's torque against that of the joint.
    gear : float
        Turns of the motor for one of the joint.
    rated_torque : float
        Rated torque of the motor, N m.

    """

    joint: str
    node_id: int
    identity: Identity
    direction: int
    gear: float
    rated_torque: float


@dataclass(frozen=True, slots=True)
class PassedCheck:
    """
    A check that has passed.

    Attributes
    ----------
    date : str
        When, as ISO 8601.
    drives : tuple of CheckedDrive
        In the order of the motors.

    """

    date: str
    drives: tuple[CheckedDrive, ...]

    def difference(self, plans: Sequence[DrivePlan]) -> str | None:
        """
        Return what is configured differently from what was checked, in words; None if nothing.

        Parameters
        ----------
        plans : sequence of DrivePlan
            The configured drives.

        """
        if len(plans) != len(self.drives):
            return f'{len(self.drives)} drives were checked, {len(plans)} are configured'
        for checked, plan in zip(self.drives, plans, strict=True):
            for name in ('joint', 'node_id', 'direction', 'gear', 'rated_torque'):
                was = getattr(checked, name)
                now = getattr(plan, name)
                if not _is_same(was, now):
                    words = name.replace('_', ' ')
                    return f'{plan.joint}: {words} {was} was checked, {now} is configured'
        return None

    def stranger(self, index: int, found: Identity) -> str | None:
        """
        Return in words that a drive is not the one that was checked; None if it is.

        Parameters
        ----------
        index : int
            Index of its motor.
        found : Identity
            Identity that the drive reports.

        """
        checked = self.drives[index].identity
        if found == checked:
            return None
        return (
            f'{found.words}; the force_check of {self.date} passed with {checked.words}: run '
            'force_check again'
        )

    def write(self, path: Path) -> None:
        """
        Write the file as JSON.

        Parameters
        ----------
        path : Path
            File; an existing one is replaced.

        Raises
        ------
        InputError
            It cannot be written.

        """
        text = json.dumps({'kind': KIND, **asdict(self)}, indent=2)
        try:
            path.write_text(text + '\n', encoding='utf-8')
        except OSError as error:
            raise InputError(f'{path}: cannot be written: {error}') from error


def passed_check(
    date: str,
    plans: Iterable[DrivePlan],
    identities: Iterable[Identity],
) -> PassedCheck:
    """
    Return the check of drives that has passed.

    Parameters
    ----------
    date : str
        Date and time, as ISO 8601.
    plans : iterable of DrivePlan
        The drives as configured.
    identities : iterable of Identity
        Identity that each reports.

    """
    drives = [
        CheckedDrive(
            joint=plan.joint,
            node_id=plan.node_id,
            identity=identity,
            direction=plan.direction,
            gear=plan.gear,
            rated_torque=plan.rated_torque,
        )
        for plan, identity in zip(plans, identities, strict=True)
    ]
    return PassedCheck(date, tuple(drives))


def read_check(path: Path) -> PassedCheck:
    """
    Return the check that a file has.

    Parameters
    ----------
    path : Path
        JSON file that `PassedCheck.write` has written.

    Returns
    -------
    PassedCheck
        Its content; whether it is about these drives is for `difference` and `stranger` to answer.

    Raises
    ------
    InputError
        The file cannot be read, or is no such file.

    """
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
        if content['kind'] != KIND:
            raise ValueError(f'kind {quoted(content["kind"])}')
        return PassedCheck(str(content['date']), tuple(map(_drive_from, content['drives'])))
    except (OSError, ValueError, ArithmeticError, RecursionError, TypeError, KeyError) as error:
        # Not repr: that of UnicodeDecodeError has the whole file.
        shown = f'it has no {error}: record it anew' if isinstance(error, KeyError) else error
        raise InputError(
            f'{path}: expected the file of a {KIND} (force_check --record --output): {shown}'
        ) from error


def _drive_from(content: dict[str, Any]) -> CheckedDrive:
    """Return one drive of the file's content; KeyError, TypeError or ValueError for another."""
    return CheckedDrive(
        joint=str(content['joint']),
        node_id=int(content['node_id']),
        identity=_identity_from(content['identity']),
        direction=int(content['direction']),
        gear=float(content['gear']),
        rated_torque=float(content['rated_torque']),
    )


def _identity_from(content: dict[str, Any]) -> Identity:
    """Return the identity in the file's content; errors as of `_drive_from`."""
    numbers = {
        name: None if content[name] is None else int(content[name])
        for name in ('vendor', 'product', 'serial', 'polarity')
    }
    return Identity(**numbers)


def _is_same(one: float | str, other: float | str) -> bool:
    """Return whether two values are the same, numbers within a share of SAME."""
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return isclose(one, other, rel_tol=SAME)
