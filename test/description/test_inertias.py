# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Masses and inertias of the URDF are those of its solids; joints have the workspace's range."""

from math import cos, pi, sin
from xml.etree import ElementTree

from built_mechanism import random_built
import numpy as np
import pytest
from spm_haptic_master.description.joint_limits import joint_limits
from spm_haptic_master.description.links import DENSITY, LEGS, masses, solids
from spm_haptic_master.description.solids import Solid, turned_profile
from spm_haptic_master.description.urdf import JOINT_SPEED, MOTOR_TORQUE, urdf
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.joints import MECHANISM_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.parameters.fkm import FKM_SETTINGS

# Corners of a turned solid.
CORNERS = 24


def prism():
    """Return an upright prism over a regular polygon: radius 0.02 m, height from 0.03 to 0.08."""
    return turned_profile([(0.02, 0.03), (0.02, 0.08)])


def test_a_prism_has_its_mass_centre_and_inertia():
    """The regular polygon's area and polar moment, by their formulas."""
    body = prism().mass_properties(1000.0)
    angle = 2.0 * pi / CORNERS
    mass = 1000.0 * 0.05 * 0.5 * CORNERS * 0.02 ** 2 * sin(angle)
    polar = mass * 0.02 ** 2 / 6.0 * (2.0 + cos(angle))
    across = 0.5 * polar + mass * 0.05 ** 2 / 12.0
    assert body.mass == pytest.approx(mass, rel=1e-12)
    assert body.centre == pytest.approx([0.0, 0.0, 0.055], abs=1e-12)
    assert np.diag(body.inertia) == pytest.approx([across, across, polar], rel=1e-9)
    assert np.abs(body.inertia - np.diag(np.diag(body.inertia))).max() < 1e-12


def test_a_body_that_is_turned_and_moved_has_the_same_inertia_turned():
    turn = np.array([[0.0, -0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, 0.6]])
    here = prism().mass_properties(700.0)
    there = Solid(prism().vertices @ turn.T + (0.3, -0.2, 0.1), prism().triangles)
    found = there.mass_properties(700.0)
    assert found.centre == pytest.approx(turn @ here.centre + (0.3, -0.2, 0.1), abs=1e-12)
    assert np.abs(found.inertia - turn @ here.inertia @ turn.T).max() < 1e-12


def volume(solid):
    """Return the volume by the flux of x through the surface (Gauss)."""
    a, b, c = np.moveaxis(solid.vertices[solid.triangles], 1, 0)
    return float(np.sum((a + b + c)[:, 0] / 3.0 * 0.5 * np.cross(b - a, c - a)[:, 0]))


@pytest.mark.parametrize('seed', [None, 1])
def test_the_links_weigh_what_their_solids_do(seed):
    geometry = Geometry() if seed is None else \
        random_built(np.random.default_rng(seed), 0.5).geometry
    bodies = masses(geometry)
    named = solids(geometry)
    expected = DENSITY * sum(volume(named[name]) for name in named if name != 'base')
    pins = [bodies.pop(f'carrier_{leg}') for leg in LEGS]
    assert sum(body.mass for body in bodies.values()) == pytest.approx(expected, rel=1e-9)
    for body in [*bodies.values(), *pins]:
        moments = np.linalg.eigvalsh(body.inertia)
        # Positive definite, and no moment exceeds the sum of the two others.
        assert moments[0] > 0.0 and moments[2] < moments[0] + moments[1]
        assert 0.001 < body.mass < 0.1


def test_the_urdf_has_a_mass_for_each_link_that_moves():
    """As MuJoCo reads it, which refuses a moving body without one."""
    mujoco = pytest.importorskip('mujoco', reason='mujoco is not installed')
    robot = ElementTree.fromstring(urdf(Geometry(), 'meshes'))
    for link in robot.iter('link'):
        for part in (*link.findall('visual'), *link.findall('collision')):
            link.remove(part)
    model = mujoco.MjModel.from_xml_string(ElementTree.tostring(robot, encoding='unicode'))
    bodies = masses(Geometry())
    assert model.body_mass.sum() == pytest.approx(
        sum(body.mass for body in bodies.values()), rel=1e-5)
    body = bodies['proximal_b']
    found = model.body('proximal_b')
    assert found.ipos == pytest.approx(body.centre, abs=1e-6)
    assert np.sort(found.inertia) == pytest.approx(np.linalg.eigvalsh(body.inertia), rel=1e-4)


@pytest.mark.parametrize('seed', [None, 1, 2])
def test_the_joints_reach_the_workspace_and_little_more(seed):
    geometry = Geometry() if seed is None else \
        random_built(np.random.default_rng(seed), 0.5).geometry
    rng = np.random.default_rng([3, seed or 0])
    found = []
    for _ in range(3000):
        pose = workspace_pose(np.radians(26.0) * np.sqrt(rng.uniform()),
                              rng.uniform(0.0, 2.0 * pi), np.radians(rng.uniform(-20.0, 100.0)))
        try:
            found.append(mechanism_angles(tuple(pose.ravel()), geometry))
        except UnreachableError:
            continue
    low, high = np.degrees(np.transpose(joint_limits(geometry)))
    angles = np.degrees(found)
    assert (angles >= low).all() and (angles <= high).all()
    assert (angles.min(axis=0) < low + 30.0).all() and (angles.max(axis=0) > high - 30.0).all()


def test_the_urdf_has_the_limits_of_the_other_rooms():
    robot = ElementTree.fromstring(urdf(Geometry(), 'meshes'))
    limits = {joint.get('name'): joint.find('limit').attrib for joint in robot.iter('joint')
              if joint.get('type') == 'revolute'}
    assert list(limits) == list(MECHANISM_JOINT_NAMES)
    for (low, high), limit in zip(joint_limits(Geometry()), limits.values(), strict=True):
        assert (float(limit['lower']), float(limit['upper'])) == pytest.approx((low, high))
    (speed,) = [each.default for each in FKM_SETTINGS if each.name == 'joint_speed']
    assert JOINT_SPEED == speed and MOTOR_TORQUE == ForceLimits().motor_torque
    assert {name for name, limit in limits.items() if float(limit['effort'])} == {
        f'joint_1{leg}' for leg in LEGS}
