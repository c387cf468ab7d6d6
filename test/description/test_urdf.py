# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The URDF, read by libraries of others: its platform has `orientation`, its legs close."""

from pathlib import Path
import re
from xml.etree import ElementTree

from built_mechanism import random_built
import numpy as np
import pytest
from spm_haptic_master.description.links import solids
from spm_haptic_master.description.urdf import urdf
from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry, inverse, mechanism_angles, workspace_pose
from spm_haptic_master.tools import urdf as urdf_tool

ROOT = Path(__file__).resolve().parents[2]
POSES = 1000
# Bound of the issue for every length (m) and component of a rotation (unit 1).
BOUND = 1e-6
# Seeds of mechanisms as built; None is the nominal one.
MECHANISMS = [None, 1, 2, 3]
NUMBER = re.compile(r'-?\d+\.?\d*(?:e-?\d+)?')


def mechanism(seed):
    if seed is None:
        return Geometry()
    return random_built(np.random.default_rng(seed), 0.5).geometry


def poses(seed):
    """Return matrices of poses within reach over the whole workspace, (POSES, 3, 3)."""
    rng = np.random.default_rng([17, seed or 0])
    n = 3 * POSES
    drawn = workspace_pose(np.radians(26.0) * np.sqrt(rng.uniform(size=n)),
                           rng.uniform(0.0, 2.0 * np.pi, n),
                           np.radians(rng.uniform(-20.0, 70.0, n)))
    reached = drawn[~np.isnan(inverse(drawn, mechanism(seed)).theta3a)]
    assert len(reached) >= POSES
    return reached[:POSES]


class MujocoTree:
    """Forward kinematics of a URDF by MuJoCo."""

    def __init__(self, folder):
        self._mujoco = pytest.importorskip('mujoco', reason='mujoco is not installed')
        text = (folder / 'spm.urdf').read_text()
        # Links without a mesh are kept as bodies; those that move have their mass.
        text = text.replace('<robot name="spm_haptic_master">', (
            '<robot name="spm_haptic_master"><mujoco><compiler strippath="true" '
            f'meshdir="{folder}/meshes" '
            'fusestatic="false" discardvisual="true"/></mujoco>'))
        self._model = self._mujoco.MjModel.from_xml_string(text)
        self._data = self._mujoco.MjData(self._model)

    def place(self, angles):
        for name, angle in zip(MECHANISM_JOINT_NAMES, angles, strict=True):
            self._data.joint(name).qpos[0] = angle
        self._mujoco.mj_kinematics(self._model, self._data)

    def frame(self, name):
        body = self._data.body(name)
        return body.xmat.reshape(3, 3), body.xpos


class YourdfpyTree:
    """Forward kinematics of a URDF by yourdfpy."""

    def __init__(self, folder):
        yourdfpy = pytest.importorskip('yourdfpy', reason='yourdfpy is not installed')
        self._robot = yourdfpy.URDF.load(str(folder / 'spm.urdf'), load_meshes=False)

    def place(self, angles):
        self._robot.update_cfg(dict(zip(MECHANISM_JOINT_NAMES, angles, strict=True)))

    def frame(self, name):
        transform = self._robot.get_transform(name, 'spm_base')
        return transform[:3, :3], transform[:3, 3]


def built(folder, seed):
    """Write URDF and meshes of a mechanism into a folder, by the command line."""
    geometry = mechanism(seed)
    parameters = [] if seed is None else [
        '-p', f'geometry.base_axes:={np.ravel(geometry.base_axes).tolist()}',
        '-p', f'geometry.platform_axes:={np.ravel(geometry.platform_axes).tolist()}',
        '-p', f'geometry.proximal_deg:={np.degrees(geometry.alphas).tolist()}',
        '-p', f'geometry.distal_deg:={np.degrees(geometry.betas).tolist()}']
    assert urdf_tool.main(['urdf', *parameters, '-o', str(folder)]) == 0
    return geometry


@pytest.mark.parametrize('tree_of', [
    MujocoTree, pytest.param(YourdfpyTree, marks=pytest.mark.slow)])
@pytest.mark.parametrize('seed', MECHANISMS)
def test_the_platform_has_the_orientation_and_the_legs_close(tmp_path, tree_of, seed):
    geometry = built(tmp_path, seed)
    tree = tree_of(tmp_path)
    worst = 0.0
    for R in poses(seed):
        tree.place(mechanism_angles(tuple(R.ravel()), geometry))
        rotation, place = tree.frame('spm_platform')
        worst = max(worst, np.abs(rotation - R).max(), np.abs(place).max())
        for leg in 'bc':
            (tip, at), (socket, there) = tree.frame(f'tip_{leg}'), tree.frame(f'socket_{leg}')
            worst = max(worst, np.abs(tip - socket).max(), np.abs(at - there).max())
            # The platform's axis Z3k, at the tip's distance from O.
            axis = R @ np.array(geometry.platform_axes['abc'.index(leg)])
            worst = max(worst, np.abs(at - np.linalg.norm(at) * axis).max())
    assert worst < BOUND


def test_a_leg_with_a_wrong_angle_does_not_close(tmp_path):
    """The test above sees it: 0.01 deg move a tip by more than its bound."""
    geometry = built(tmp_path, None)
    tree = MujocoTree(tmp_path)
    angles = list(mechanism_angles(tuple(poses(None)[0].ravel()), geometry))
    angles[MECHANISM_JOINT_NAMES.index('joint_2b')] += np.radians(0.01)
    tree.place(angles)
    assert np.abs(tree.frame('tip_b')[1] - tree.frame('socket_b')[1]).max() > BOUND


def test_the_tree_is_one(tmp_path):
    """Each link has one parent but the base; leg A alone carries the platform."""
    robot = ElementTree.fromstring(urdf(Geometry(), 'meshes'))
    links = [link.get('name') for link in robot.iter('link')]
    parents = {joint.find('child').get('link'): joint.find('parent').get('link')
               for joint in robot.iter('joint')}
    assert len(set(links)) == len(links)
    assert set(links) - set(parents) == {'spm_base'}
    assert set(parents.values()) | set(parents) == set(links)
    way = ['spm_platform']
    while way[-1] in parents:
        way.append(parents[way[-1]])
    assert way == ['spm_platform', 'carrier_a', 'distal_a', 'proximal_a', 'spm_base']
    turning = [joint.get('name') for joint in robot.iter('joint')
               if joint.get('type') == 'revolute']
    assert turning == list(MECHANISM_JOINT_NAMES)


def test_the_installed_files_are_current():
    """Those in urdf/ are what `make docs` writes, to the rounding of another machine's sine."""
    def numbers(text):
        return np.array(NUMBER.findall(text), dtype=float), NUMBER.sub('#', text)

    made = numbers(urdf(Geometry(), 'package://spm_haptic_master/urdf/meshes'))
    found = numbers((ROOT / 'urdf' / 'spm.urdf').read_text())
    assert made[1] == found[1], 'run `make docs`'
    assert np.abs(made[0] - found[0]).max() < 1e-12, 'run `make docs`'
    named = solids(Geometry())
    meshes = {path.stem: path.read_bytes() for path in (ROOT / 'urdf' / 'meshes').iterdir()}
    assert set(meshes) == set(named), 'run `make docs`'
    for name, solid in named.items():
        count = len(solid.triangles)
        layout = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('rest', '<u2')])
        file = meshes[name]
        assert len(file) == 84 + 50 * count, 'run `make docs`'
        corners = np.frombuffer(file, layout, count, 84)['corners']
        assert np.abs(corners - solid.vertices[solid.triangles]).max() < 1e-7, 'run `make docs`'
    assert sum(map(len, meshes.values())) < 500_000


@pytest.mark.parametrize('arguments', [
    ['-p', 'geometry.base_axes:=[1.0, 0.0, 0.0]'], ['-p', 'rate:=100.0'], ['-o', '/proc/urdf']])
def test_wrong_arguments_end_in_one_line(capsys, arguments):
    assert urdf_tool.main(['urdf', *arguments]) == 1
    assert capsys.readouterr().err.count('\n') == 1
