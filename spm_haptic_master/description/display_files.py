# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The files that displays are given: the URDF with its meshes, and the layout of Foxglove."""

from __future__ import annotations

from pathlib import Path
import re

from spm_haptic_master.description.links import solids
from spm_haptic_master.description.urdf import urdf
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry

# Names of the file and of the directory of meshes.
URDF_NAME, MESHES_NAME = 'spm.urdf', 'meshes'
# What the installed URDF names its directory by.
INSTALLED = 'package://spm_haptic_master/urdf'
# What a namespace is put behind in the layout: the slash of a topic, but of the one of all nodes;
# what is before the name of a node on that, before the base frame, before the prefix of all links.
BEFORE = re.compile(
    r'"/(?!diagnostics["\.])|\{name==\\"|"(?=spm_base")|"framePrefix": "')


def write(geometry: Geometry, directory: Path, prefix: str) -> Path:
    """
    Write the URDF, which names its directory by a prefix, and its meshes; return its path.

    InputError: the files cannot be written.
    """
    try:
        (directory / MESHES_NAME).mkdir(parents=True, exist_ok=True)
        for name, solid in solids(geometry).items():
            (directory / MESHES_NAME / f'{name}.stl').write_bytes(solid.stl(name))
        (directory / URDF_NAME).write_text(
            urdf(geometry, f'{prefix}/{MESHES_NAME}'), encoding='utf-8')
    except OSError as error:
        raise InputError(f'{directory}: cannot be written: {error}') from error
    return directory / URDF_NAME


def describe(geometry: Geometry, directory: Path) -> str:
    """Return the URDF of a mechanism as text; its meshes, unless installed, in a directory."""
    if geometry == Geometry():
        return urdf(geometry, f'{INSTALLED}/{MESHES_NAME}')
    return write(geometry, directory, directory.absolute().as_uri()).read_text(encoding='utf-8')


def foxglove_layout(template: str, namespace: str) -> str:
    """Return the layout `config/foxglove_layout.json` for an arm; its namespace, or empty."""
    return BEFORE.sub(lambda match: f'{match[0]}{namespace}/', template) \
        if namespace else template
