# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The URDF, read by libraries of others: its platform has `orientation`, its legs close."""

from pathlib import Path
import re
from xml.etree import ElementTree

from built_mechanism import random_built
import numpy as np
import pytest
from spm_haptic_master.description import solids, urdf
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.kinematics import Geometry, inverse, mechanism_angles, workspace_pose
from spm_haptic_master.kinematics.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.parameters.fkm import FKM_SETTINGS

ROOT = Path(__file__).resolve().parents[2]
# Bound of every length (m) and component of a rotation (unit 1).
BOUND = 1e-6
MECHANISMS = [Geometry(), random_built(np.random.default_rng(1), 0.5).geometry]
NUMBER = re.compile(r'-?\d+\.?\d*(?:e-?\d+)?')


def poses(geometry, largest_deg):
    """Return matrices of poses within reach over the whole workspace."""
    rng = np.random.default_rng(17)
    n = 3000
    drawn = workspace_pose(
        np.radians(26.0) * np.sqrt(rng.uniform(size=n)),
        rng.uniform(0.0, 2.0 * np.pi, n),
        np.radians(rng.uniform(-20.0, largest_deg, n)),
    )
    return drawn[~np.isnan(inverse(drawn, geometry).theta3a)]


class MujocoTree:
    """Forward kinematics of a URDF by MuJoCo."""

    def __init__(self, folder):
        self._mujoco = pytest.importorskip('mujoco', reason='mujoco is not installed')
        # Links without a mesh are kept as bodies; those that move have their mass.
        text = (
            (folder / 'spm.urdf')
            .read_text()
            .replace(
                '<robot name="spm_haptic_master">',
                (
                    '<robot name="spm_haptic_master"><mujoco><compiler strippath="true" '
                    f'meshdir="{folder}/meshes" fusestatic="false" discardvisual="true"/></mujoco>'
                ),
            )
        )
        self.model = self._mujoco.MjModel.from_xml_string(text)
        self._data = self._mujoco.MjData(self.model)

    def place(self, angles):
        for name, angle in zip(MECHANISM_JOINT_NAMES, angles, strict=True):
            self._data.joint(name).qpos[0] = angle
        self._mujoco.mj_kinematics(self.model, self._data)

    def frame(self, name):
        body = self._data.body(name)
        return body.xmat.reshape(3, 3), body.xpos


@pytest.mark.parametrize('geometry', MECHANISMS)
def test_the_platform_has_the_orientation_and_the_legs_close(tmp_path, geometry):
    urdf.write(geometry, tmp_path, tmp_path.as_uri())
    tree = MujocoTree(tmp_path)
    for name, body in solids.masses(geometry).items():
        found = tree.model.body(name)
        assert found.mass == pytest.approx(body.mass, rel=1e-5)
        assert found.ipos == pytest.approx(body.centre, abs=1e-6)
        assert np.sort(found.inertia) == pytest.approx(np.linalg.eigvalsh(body.inertia), rel=1e-4)
    worst = 0.0
    for R in poses(geometry, 70.0)[:300]:
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


def test_the_joints_have_the_limits_of_the_other_rooms():
    robot = ElementTree.fromstring(urdf.urdf(Geometry(), 'meshes'))
    limits = {
        joint.get('name'): joint.find('limit').attrib
        for joint in robot.iter('joint')
        if joint.get('type') == 'revolute'
    }
    assert list(limits) == list(MECHANISM_JOINT_NAMES)
    (speed,) = [each.default for each in FKM_SETTINGS if each.name == 'joint_speed']
    assert urdf.JOINT_SPEED == speed
    assert urdf.MOTOR_TORQUE == ForceLimits().motor_torque
    assert {name for name, limit in limits.items() if float(limit['effort'])} == {
        f'joint_1{leg}' for leg in solids.LEGS
    }


@pytest.mark.parametrize('geometry', MECHANISMS)
def test_the_joints_reach_the_workspace_and_little_more(geometry):
    found = [
        np.degrees(mechanism_angles(tuple(pose.ravel()), geometry))
        for pose in poses(geometry, 100.0)
    ]
    low, high = np.degrees(np.transpose(urdf.joint_limits(geometry)))
    least = np.min(found, axis=0)
    largest = np.max(found, axis=0)
    assert (least >= low).all()
    assert (largest <= high).all()
    assert (least < low + 30.0).all()
    assert (largest > high - 30.0).all()


def test_the_installed_files_are_current():
    """Those in urdf/ are what `make docs` writes, to the rounding of another machine's sine."""

    def numbers(text):
        return np.array(NUMBER.findall(text), dtype=float), NUMBER.sub('#', text)

    made = numbers(urdf.urdf(Geometry(), 'package://spm_haptic_master/urdf/meshes'))
    found = numbers((ROOT / 'urdf' / 'spm.urdf').read_text())
    assert made[1] == found[1], 'run `make docs`'
    assert np.abs(made[0] - found[0]).max() < 1e-12, 'run `make docs`'
    named = solids.solids(Geometry())
    meshes = {path.stem: path.read_bytes() for path in (ROOT / 'urdf' / 'meshes').iterdir()}
    assert set(meshes) == set(named), 'run `make docs`'
    for name, solid in named.items():
        count = len(solid.triangles)
        layout = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('rest', '<u2')])
        file = meshes[name]
        assert len(file) == 84 + 50 * count, 'run `make docs`'
        facets = np.frombuffer(file, layout, count, 84)
        corners = solid.vertices[solid.triangles]
        assert np.abs(facets['corners'] - corners).max() < 1e-7, 'run `make docs`'
        written = np.frombuffer(solid.stl(name), layout, count, 84)['normal']
        outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1])
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        assert np.abs(written - outward).max() < 1e-4


def test_files_that_cannot_be_written_are_an_error_of_the_user():
    with pytest.raises(InputError, match='/proc/urdf: cannot be written'):
        urdf.write(Geometry(), Path('/proc/urdf'), '')
