# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Surfaces of the scene, all of one kind, which has two programs of the graphics processor.

Each kind of surface (a mesh or a batch, smooth or flat, seen from one side or from both) has a
program of its own, which a browser without a GPU compiles for 0.1 s and more, before the page has
its first picture. Here there is one for what is opaque, and one for what is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description.solids import onto, Solid, turned_profile
from spm_haptic_master.kinematics import quaternion_from_matrix
from viser import BatchedMeshHandle, SceneApi

# Colour of a device that is not shown as it is now, and of encoders without a state.
GREY = '#969696'
# An arrow of length 1 along z, of a profile of radius and height.
ARROW = turned_profile([(0.018, 0.0), (0.018, 0.75), (0.05, 0.75), (0.001, 1.0)])


def add(
    scene: SceneApi,
    path: str,
    solid: Solid,
    colours: NDArray[np.uint8],
    axes: Sequence[object] | NDArray[np.float64] | None = None,
    places: NDArray[np.float64] | None = None,
    scale: float = 1.0,
    opacity: float | None = None,
    visible: bool = True,
) -> BatchedMeshHandle:
    """
    Add a solid, scaled, once for each colour.

    Parameters
    ----------
    scene : SceneApi
        The scene of the page.
    path : str
        Name in the scene.
    solid : Solid
        The surface, seen from outside.
    colours : ndarray of uint8, shape (n, 3)
        Red, green, blue of each copy, 0 .. 255, as of `rgb`.
    axes : sequence of n unit vectors, optional
        Direction of each copy's z; by default the copies are not turned.
    places : ndarray, shape (n, 3), optional
        Position of each copy (units of the scene); by default the origin.
    scale : float
        Factor of the solid's size.
    opacity : float, optional
        Below 1 what is behind is seen through it; by default the surface is opaque.
    visible : bool
        Whether it is shown at first.

    Returns
    -------
    BatchedMeshHandle
        All copies, by which they can be turned, coloured and hidden.

    """
    count = len(colours)
    if axes is None:
        turns = np.array([np.eye(3)] * count)
    else:
        turns = onto(axes)
    return scene.add_batched_meshes_simple(
        path,
        solid.vertices * scale,
        solid.triangles,
        wxyz(turns),
        np.zeros((count, 3)) if places is None else places,
        batched_colors=colours,
        opacity=opacity,
        flat_shading=True,
        side='front',
        lod='off',
        cast_shadow=False,
        receive_shadow=False,
        visible=visible,
    )


def rgb(colours: Sequence[str]) -> NDArray[np.uint8]:
    """
    Return red, green, blue, 0 .. 255, shape (n, 3), of colours as CSS has them: #rrggbb.

    Parameters
    ----------
    colours : sequence of n str
        #rrggbb.

    """
    return np.array([list(bytes.fromhex(colour[1:])) for colour in colours], np.uint8)


def wxyz(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return the quaternions of rotation matrices, (..., 3, 3), as viser orders them, (..., 4).

    Parameters
    ----------
    rotations : ndarray, shape (..., 3, 3)
        Rotation matrices.

    """
    return quaternion_from_matrix(rotations)[..., [3, 0, 1, 2]]


def two_sided(solid: Solid) -> Solid:
    """
    Return a surface that is seen from above and from below.

    The triangles seen from above come first: of a cone they are the far wall, which is drawn
    before the near one.
    """
    return Solid(solid.vertices, np.concatenate([solid.triangles, solid.triangles[:, ::-1]]))


def fan(
    radius: float,
    height: float,
    corners: int,
) -> Solid:
    """
    Return the triangles from O to a regular polygon about z at a height, seen from above.

    Parameters
    ----------
    radius : float
        Distance of the polygon's corners from z.
    height : float
        z of the corners, same unit; at 0 the fan is a disc, else a cone with its tip in O.
    corners : int
        Number of corners, and of triangles.

    Returns
    -------
    Solid
        An open surface.

    """
    turn = np.arange(corners) * 2.0 * pi / corners
    here = np.arange(1, corners + 1)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.0 * turn + height], axis=1)
    return Solid(
        np.concatenate([np.zeros((1, 3)), rim]),
        np.stack([np.zeros_like(here), here, np.roll(here, -1)], axis=1),
    )


def ball(radius: float) -> Solid:
    """
    Return a ball about O.

    Parameters
    ----------
    radius : float
        Radius, in the unit of the surface.

    """
    turn = np.linspace(-0.5 * pi, 0.5 * pi, 9)
    return turned_profile([(radius * np.cos(angle), radius * np.sin(angle)) for angle in turn])
