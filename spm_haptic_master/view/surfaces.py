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

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.kinematics import quaternion_from_matrix
from viser import BatchedMeshHandle, SceneApi


def add(scene: SceneApi, path: str, vertices: NDArray[np.float64], triangles: NDArray[np.int32],
        colours: NDArray[np.uint8], turns: Sequence[NDArray[np.float64]],
        places: NDArray[np.float64] | None = None, opacity: float | None = None,
        visible: bool = True) -> BatchedMeshHandle:
    """
    Add a surface several times.

    Parameters
    ----------
    scene : SceneApi
        Scene of the page.
    path : str
        Name in the scene.
    vertices, triangles : ndarray, shapes (n, 3) and (m, 3)
        Corners, and which of them are joined, counter-clockwise from where they are seen.
    colours : ndarray, shape (count, 3)
        Red, green, blue of each, 0 to 255.
    turns : sequence of ndarrays, shape (3, 3)
        Rotation matrix of each.
    places : ndarray, shape (count, 3), optional
        Where each is; without it all are at the origin.
    opacity : float, optional
        Less than 1 where others are seen through it.
    visible : bool
        Whether it is shown at first.

    """
    return scene.add_batched_meshes_simple(
        path, vertices, triangles, quaternion_from_matrix(np.stack(turns))[:, [3, 0, 1, 2]],
        np.zeros((len(colours), 3)) if places is None else places, batched_colors=colours,
        opacity=opacity, flat_shading=True, side='front', lod='off', cast_shadow=False,
        receive_shadow=False, visible=visible)


def two_sided(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """
    Return the triangles of a surface that is seen from both sides, shape (2 m, 3).

    Those seen from behind come first: of a cone they are the far wall, which is drawn before the
    near one.
    """
    return np.concatenate([triangles[:, ::-1], triangles])
