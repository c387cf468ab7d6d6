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


@pytest.fixture(params=MECHANISMS)
def mechanism(request, tmp_path):
    """Return a mechanism, and what MuJoCo makes of its files."""
    urdf.write(request.param, tmp_path, tmp_path.as_uri())
    return request.param, MujocoTree(tmp_path)


def test_the_parts_have_the_masses_of_their_solids(mechanism):
    geometry, tree = mechanism
    for name, body in solids.masses(geometry).items():
        found = tree.model.body(name)
        assert found.mass == pytest.approx(body.mass, rel=1e-5)
        assert found.ipos == pytest.approx(body.centre, abs=1e-6)
        principal = np.linalg.eigvalsh(body.inertia)
        assert np.sort(found.inertia) == pytest.approx(principal, rel=1e-4)


def test_the_platform_has_the_orientation_and_the_legs_close(mechanism):
    geometry, tree = mechanism
    for R in poses(geometry, 70.0)[:300]:
        tree.place(mechanism_angles(tuple(R.ravel()), geometry))
        rotation, place = tree.frame('spm_platform')
        assert np.abs(rotation - R).max() < BOUND
        assert np.abs(place).max() < BOUND
        for leg in 'bc':
            tip_rotation, tip = tree.frame(f'tip_{leg}')
            socket_rotation, socket = tree.frame(f'socket_{leg}')
            assert np.abs(tip_rotation - socket_rotation).max() < BOUND
            assert np.abs(tip - socket).max() < BOUND
            # The platform's axis Z3k, at the tip's distance from O.
            axis = R @ np.array(geometry.platform_axes['abc'.index(leg)])
            assert np.abs(tip - np.linalg.norm(tip) * axis).max() < BOUND


def test_the_joints_have_the_limits_of_the_other_rooms():
    robot = ElementTree.fromstring(urdf.urdf(Geometry(), 'meshes'))
    joints = [joint for joint in robot.iter('joint') if joint.get('type') == 'revolute']
    names = [joint.get('name') for joint in joints]
    assert names == list(MECHANISM_JOINT_NAMES)
    defaults = {setting.name: setting.default for setting in FKM_SETTINGS}
    assert urdf.JOINT_SPEED == defaults['joint_speed']
    assert urdf.MOTOR_TORQUE == ForceLimits().motor_torque
    driven = [joint.get('name') for joint in joints if float(joint.find('limit').attrib['effort'])]
    assert sorted(driven) == [f'joint_1{leg}' for leg in solids.LEGS]


@pytest.mark.parametrize('geometry', MECHANISMS)
def test_the_joints_reach_the_workspace_and_little_more(geometry):
    found = []
    for pose in poses(geometry, 100.0):
        angles = mechanism_angles(tuple(pose.ravel()), geometry)
        found.append(np.degrees(angles))
    low, high = np.degrees(np.transpose(urdf.joint_limits(geometry)))
    least = np.min(found, axis=0)
    largest = np.max(found, axis=0)
    assert (least >= low).all()
    assert (largest <= high).all()
    assert (least < low + 30.0).all()
    assert (largest > high - 30.0).all()


def numbers(text):
    """Return the numbers of a text, and the text without them."""
    return np.array(NUMBER.findall(text), dtype=float), NUMBER.sub('#', text)


def facets(file, count):
    """Return the triangles of an STL file."""
    layout = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('rest', '<u2')])
    return np.frombuffer(file, layout, count, 84)


def test_the_installed_description_is_current():
    """That in urdf/ is what `make docs` writes, to the rounding of another machine's sine."""
    made = urdf.urdf(Geometry(), 'package://spm_haptic_master/urdf/meshes')
    made_numbers, made_text = numbers(made)
    found_numbers, found_text = numbers((ROOT / 'urdf' / 'spm.urdf').read_text())
    assert made_text == found_text, 'run `make docs`'
    assert np.abs(made_numbers - found_numbers).max() < 1e-12, 'run `make docs`'


def test_the_installed_meshes_are_current():
    named = solids.solids(Geometry())
    meshes = {path.stem: path.read_bytes() for path in (ROOT / 'urdf' / 'meshes').iterdir()}
    assert set(meshes) == set(named), 'run `make docs`'
    for name, solid in named.items():
        count = len(solid.triangles)
        assert len(meshes[name]) == 84 + 50 * count, 'run `make docs`'
        found = facets(meshes[name], count)['corners']
        corners = solid.vertices[solid.triangles]
        assert np.abs(found - corners).max() < 1e-7, 'run `make docs`'


def test_the_normals_of_a_mesh_are_those_of_its_corners():
    for name, solid in solids.solids(Geometry()).items():
        corners = solid.vertices[solid.triangles]
        first = corners[:, 1] - corners[:, 0]
        second = corners[:, 2] - corners[:, 1]
        outward = np.cross(first, second)
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        written = facets(solid.stl(name), len(corners))['normal']
        assert np.abs(written - outward).max() < 1e-4


def test_files_that_cannot_be_written_are_an_error_of_the_user():
    with pytest.raises(InputError, match='/proc/urdf: cannot be written'):
        urdf.write(Geometry(), Path('/proc/urdf'), '')
