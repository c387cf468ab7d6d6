# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mechanism as URDF: a tree, because URDF has no closed loops; its files, and Foxglove's layout.

Joints have the range of the workspace; moving links the mass and inertia of their solids.

Leg A carries the platform. The legs B and C are branches of their own: they meet the platform
where the angles of all nine joints (`joint_states`) belong to one pose. All joints' frames have
their origin in O, the centre of rotation.

From the base frame `spm_base`, `proximal_k`, `distal_k` and `carrier_k` come after the joints 1k,
2k and 3k, z on their axes; `tip_k` is `carrier_k` at the leg's tip. `spm_platform`, which has the
published orientation, is fixed to `carrier_a`, and to it `socket_b` and `socket_c`, where the tips
of the legs B and C belong.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, ceil, cos, floor, hypot, pi, radians, sin
from pathlib import Path
import re
from xml.etree.ElementTree import Element, indent, SubElement, tostring

import numpy as np
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import COLOURS
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry, workspace_pose
from spm_haptic_master.kinematics.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics.leg_kernels import leg_angles
from spm_haptic_master.kinematics.number_backends import ARRAYS, Rotation
from spm_haptic_master.kinematics.rotations import unstack_matrix

# Frames of base and platform, as `fkm` names them by default.
BASE_FRAME, PLATFORM_FRAME = 'spm_base', 'spm_platform'
# Distance of the legs' tips from O (m): in the gap between distal link and platform.
TIP = 0.77 * solids.SIZE
# Limits of the joints' speed (rad/s) and of the motors' torque (N m); passive joints have none.
JOINT_SPEED, MOTOR_TORQUE = 20.0, 0.5
# Step of self-rotation and azimuth of the poses whose angles are taken (deg).
STEP_DEG = 5.0
# Limits are this farther out than the angles found, and then on a grid of this step (rad): between
# the poses a joint goes beyond these angles by less, most where its leg is nearly stretched.
MARGIN = radians(5.0)
# Names of the file and of the directory of meshes.
URDF_NAME, MESHES_NAME = 'spm.urdf', 'meshes'
# What the installed URDF names its directory by.
INSTALLED = 'package://spm_haptic_master/urdf'
# Text before a namespace in the layout: the slash of each topic but /diagnostics, and the text
# before the name of a node there, the base frame, and the prefix of all links.
BEFORE = re.compile(r'"/(?!diagnostics["\.])|\{name==\\"|"(?=spm_base")|"framePrefix": "')


def urdf(geometry: Geometry, meshes: str) -> str:
    """
    Return the URDF of a mechanism.

    The names of the mesh files begin with `meshes`: `package://PACKAGE/...`, `file:///...` or a
    path, without the last slash.
    """
    robot = Element('robot', name='spm_haptic_master')
    for name, rgb in COLOURS.items():
        SubElement(SubElement(robot, 'material', name=name), 'color', rgba=_numbers((*rgb, 1.0)))
    base = _link(robot, BASE_FRAME, f'{meshes}/base.stl', 'base')
    for leg in geometry.legs:
        _add_encoder(base, solids.MOTOR_ENCODER, leg.base_frame)
    limits = iter(zip(MECHANISM_JOINT_NAMES, joint_limits(geometry), strict=True))
    for leg, name in zip(geometry.legs, solids.LEGS, strict=True):
        proximal, distal, carrier = f'proximal_{name}', f'distal_{name}', f'carrier_{name}'
        end = _about_x(leg.cos_beta, leg.sin_beta)
        _turning(robot, *next(limits), BASE_FRAME, proximal, leg.base_frame, MOTOR_TORQUE)
        _link(robot, proximal, f'{meshes}/{proximal}.stl', f'leg_{name}')
        _turning(robot, *next(limits), proximal, distal, _about_x(leg.cos_alpha, leg.sin_alpha))
        link = _link(robot, distal, f'{meshes}/{distal}.stl', f'leg_{name}')
        if name == solids.LEGS[0]:
            _add_encoder(link, solids.THIRD_ENCODER, end)
        _turning(robot, *next(limits), distal, carrier, end)
        _link(robot, carrier)
        _joint(
            robot, f'tip_{name}_joint', 'fixed', carrier, f'tip_{name}', _about_x(1.0, 0.0), TIP
        )
        _link(robot, f'tip_{name}')
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = geometry.legs[0].platform_frame
    _joint(
        robot,
        'platform_joint',
        'fixed',
        'carrier_a',
        PLATFORM_FRAME,
        (r00, r10, r20, r01, r11, r21, r02, r12, r22),
    )
    _link(robot, PLATFORM_FRAME, f'{meshes}/platform.stl', 'platform')
    for leg, name in zip(geometry.legs[1:], solids.LEGS[1:], strict=True):
        _joint(
            robot,
            f'socket_{name}_joint',
            'fixed',
            PLATFORM_FRAME,
            f'socket_{name}',
            leg.platform_frame,
            TIP,
        )
        _link(robot, f'socket_{name}')
    links = {link.get('name'): link for link in robot.iter('link')}
    for name, body in solids.masses(geometry).items():
        _add_inertial(links[name], body)
    indent(robot)
    return (
        '<?xml version="1.0"?>\n<!-- Generated by `spm_haptic_master urdf`: change the '
        'generator. -->\n' + tostring(robot, encoding='unicode') + '\n'
    )


def _link(robot: Element, name: str, mesh: str = '', material: str = '') -> Element:
    """Add a link, with one mesh to see and to collide with."""
    link = SubElement(robot, 'link', name=name)
    for kind in ('visual', 'collision') if mesh else ():
        part = SubElement(link, kind)
        SubElement(SubElement(part, 'geometry'), 'mesh', filename=mesh)
        if kind == 'visual':
            SubElement(part, 'material', name=material)
    return link


def _add_inertial(link: Element, body: solids.MassProperties) -> None:
    """Add mass, centre (m, to a tenth of a micrometre) and inertia of a link."""
    part = SubElement(link, 'inertial')
    centre = ' '.join(f'{round(float(value), 7) + 0.0:.7g}' for value in body.centre)
    SubElement(part, 'origin', xyz=centre, rpy='0 0 0')
    SubElement(part, 'mass', value=f'{body.mass:.6g}')
    SubElement(
        part,
        'inertia',
        {
            f'i{"xyz"[row]}{"xyz"[column]}': f'{body.inertia[row, column]:.6g}'
            for row in range(3)
            for column in range(row, 3)
        },
    )


def _add_encoder(link: Element, size: Sequence[float], frame: Rotation[float]) -> None:
    """Add the cylinder of an encoder, as `cylinder` has its size, on z of a frame in a link."""
    radius, low, high = (solids.SIZE * each for each in size)
    part = SubElement(link, 'visual')
    _origin(part, frame, 0.5 * (low + high))
    SubElement(
        SubElement(part, 'geometry'),
        'cylinder',
        radius=f'{radius:.6g}',
        length=f'{high - low:.6g}',
    )
    SubElement(part, 'material', name='encoder')


def _turning(
    robot: Element,
    name: str,
    limits: tuple[float, float],
    parent: str,
    child: str,
    frame: Rotation[float],
    effort: float = 0.0,
) -> None:
    """Add a joint that turns about z of a frame in its parent, within limits in rad."""
    joint = _joint(robot, name, 'revolute', parent, child, frame)
    SubElement(joint, 'axis', xyz='0 0 1')
    low, high = limits
    SubElement(
        joint,
        'limit',
        lower=f'{low:.9g}',
        upper=f'{high:.9g}',
        effort=f'{effort:g}',
        velocity=f'{JOINT_SPEED:g}',
    )


def _joint(
    robot: Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    frame: Rotation[float],
    height: float = 0.0,
) -> Element:
    joint = SubElement(robot, 'joint', name=name, type=kind)
    SubElement(joint, 'parent', link=parent)
    SubElement(joint, 'child', link=child)
    _origin(joint, frame, height)
    return joint


def _origin(element: Element, frame: Rotation[float], height: float) -> None:
    """Add a frame at a height on its own z, m; roll and pitch are exact at 90 deg."""
    r00, r01, r02, r10, r11, r12, r20, _, r22 = frame
    yaw = atan2(r10, r00)
    c, s = cos(yaw), sin(yaw)
    rpy = atan2(s * r02 - c * r12, c * r11 - s * r01), atan2(-r20, hypot(r00, r10)), yaw
    SubElement(
        element, 'origin', xyz=_numbers([height * z for z in (r02, r12, r22)]), rpy=_numbers(rpy)
    )


def _about_x(cosine: float, sine: float) -> Rotation[float]:
    return 1.0, 0.0, 0.0, 0.0, cosine, -sine, 0.0, sine, cosine


def _numbers(values: Sequence[float]) -> str:
    # Adding 0 makes -0 a 0; rounding hides the difference of another machine's sine.
    return ' '.join(f'{round(value, 15) + 0.0:.15g}' for value in values)


def joint_limits(geometry: Geometry) -> tuple[tuple[float, float], ...]:
    """
    Return the least and the largest angle of all nine joints in the workspace, rad.

    The workspace is the cone of 26 deg at self-rotations from -20 to 100 deg, without the poses
    that a leg does not reach. The joints are in the order of MECHANISM_JOINT_NAMES.
    """
    grid = np.ix_(
        np.radians([0.0, 20.0, 26.0]),
        np.radians(np.arange(0.0, 360.0, STEP_DEG)),
        np.radians(np.arange(-20.0, 100.0 + STEP_DEG, STEP_DEG)),
    )
    rotation = unstack_matrix(workspace_pose(*grid))
    angles = np.stack(
        [angle for leg in geometry.legs for angle in leg_angles(rotation, leg, 1, ARRAYS)]
    )
    reached = angles[:, np.isfinite(angles).all(axis=0)]
    return tuple(
        (max(-pi, (floor(low / MARGIN) - 1) * MARGIN), min(pi, (ceil(high / MARGIN) + 1) * MARGIN))
        for low, high in zip(reached.min(axis=1), reached.max(axis=1), strict=True)
    )


def write(geometry: Geometry, directory: Path, prefix: str) -> Path:
    """
    Write the URDF, which names its directory by a prefix, and its meshes; return its path.

    InputError: the files cannot be written.
    """
    try:
        (directory / MESHES_NAME).mkdir(parents=True, exist_ok=True)
        for name, solid in solids.solids(geometry).items():
            (directory / MESHES_NAME / f'{name}.stl').write_bytes(solid.stl(name))
        (directory / URDF_NAME).write_text(
            urdf(geometry, f'{prefix}/{MESHES_NAME}'), encoding='utf-8'
        )
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
    return BEFORE.sub(lambda match: f'{match[0]}{namespace}/', template) if namespace else template
