# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which room may import which: downwards only, and each room only what its purpose needs."""

import ast
from functools import cache
from pathlib import Path
import sys

from spm_haptic_master.executables import FOLLOWER, PIPELINE

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = 'spm_haptic_master'

# The top-level modules: each imports others of them and no room.
TOP_LEVEL = {'__init__', '__main__', 'exceptions', 'executables', 'standard_streams', 'timing'}
# The rooms, lowest first, and what each may import of the others.
ROOMS = {
    'kinematics': set(),
    'parameters': {'kinematics'},
    'supervision': {'parameters', 'kinematics'},
    'force': {'kinematics'},
    'encoders': {'parameters', 'kinematics'},
    'drives': {'encoders', 'parameters', 'kinematics'},
    'simulation': {'drives', 'encoders', 'parameters', 'kinematics'},
    'validation': {'encoders', 'parameters', 'kinematics'},
    'calibration': {'validation', 'encoders', 'parameters', 'kinematics'},
    'teleoperation': {'supervision', 'kinematics'},
    'description': {'kinematics'},
    'ros': {'parameters', 'kinematics'},
    'nodes': {
        'ros',
        'teleoperation',
        'calibration',
        'force',
        'supervision',
        'drives',
        'encoders',
        'simulation',
        'parameters',
        'kinematics',
    },
    'view': {
        'nodes',
        'ros',
        'description',
        'simulation',
        'force',
        'supervision',
        'parameters',
        'kinematics',
    },
    'tools': {
        'nodes',
        'description',
        'validation',
        'calibration',
        'simulation',
        'drives',
        'encoders',
        'force',
        'supervision',
        'parameters',
        'kinematics',
    },
    'paper': {'validation', 'description', 'simulation', 'parameters', 'kinematics'},
    'study': {
        'paper',
        'validation',
        'description',
        'force',
        'supervision',
        'parameters',
        'kinematics',
    },
}
# What each may import from outside, beside the standard library; '' is the top level.
OUTSIDE = {
    '': set(),
    'kinematics': {'numpy'},
    'parameters': {'yaml'},
    'supervision': {'numpy'},
    'force': {'numpy'},
    'encoders': {'can', 'canopen', 'cantools', 'numpy'},
    'drives': {'can'},
    'simulation': {'can'},
    'calibration': {'numpy', 'matplotlib', 'yaml'},
    'validation': {'numpy', 'matplotlib', 'rosbags', 'yaml'},
    'teleoperation': set(),
    'description': {'numpy'},
    'ros': {'rclpy', 'rcl_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'sensor_msgs'},
    'nodes': {
        'rclpy',
        'crtk_msgs',
        'rcl_interfaces',
        'diagnostic_msgs',
        'geometry_msgs',
        'sensor_msgs',
        'std_msgs',
        'std_srvs',
        'tf2_msgs',
    },
    'view': {
        'numpy',
        'rclpy',
        'viser',
        'websockets',
        'msgspec',
        'diagnostic_msgs',
        'geometry_msgs',
        'rcl_interfaces',
        'sensor_msgs',
        'std_msgs',
    },
    'tools': {'numpy', 'can'},
    'paper': {'numpy', 'matplotlib', 'mujoco', 'benchmarks'},
    'study': {'numpy', 'matplotlib', 'mujoco'},
}
# Rooms outside the installed package.
NOT_INSTALLED = {'paper', 'study'}
# Rooms of mathematics.
WITHOUT_CLOCK = ('kinematics', 'supervision', 'force', 'calibration/watch', 'teleoperation')
NODES = {*PIPELINE, FOLLOWER, 'master', 'presence', 'sim_slave'}


@cache
def files() -> tuple[tuple[str, Path, set[str]], ...]:
    """Return the room ('' at the top level), the path and the imports of each file."""
    found = []
    for path in sorted(
        path for folder in (PACKAGE, *NOT_INSTALLED) for path in (ROOT / folder).rglob('*.py')
    ):
        parts = path.relative_to(ROOT).parts
        room = parts[0] if parts[0] in NOT_INSTALLED else parts[1] if len(parts) > 2 else ''
        found.append((room, path.relative_to(ROOT), imports(path)))
    return tuple(found)


@cache
def imports(path: Path) -> set[str]:
    """Return the dotted names that a file imports anywhere, modules imported by name included."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {'.' * node.level + (node.module or '')}
            if node.module == PACKAGE:
                found |= {f'{PACKAGE}.{alias.name}' for alias in node.names}
    return found


def test_every_room_is_declared_above_those_that_it_imports():
    """ROOMS is in an order in which each room rests on earlier ones only: there is no circle."""
    assert {room for room, _, _ in files()} == {'', *ROOMS} == set(OUTSIDE)
    order = list(ROOMS)
    assert [
        (room, other)
        for room, others in ROOMS.items()
        for other in others
        if order.index(other) >= order.index(room)
    ] == []


def test_each_room_imports_what_is_declared_for_it():
    """Beside itself, top-level modules and the standard library; all that is declared is used."""
    used = {room: {} for room in OUTSIDE}
    for room, path, names in files():
        for name in names:
            first, _, rest = name.partition('.')
            used[room][rest.partition('.')[0] if first == PACKAGE else first] = path
    for room, found in used.items():
        other = found.keys() - {room, '', *TOP_LEVEL, *sys.stdlib_module_names}
        declared = ROOMS.get(room, set()) | OUTSIDE[room]
        different = {name: str(found.get(name)) for name in other ^ declared}
        assert not different, (
            f'{room}: its imports are not those of ROOMS and OUTSIDE in test/test_house.py, by '
            f'name and file that imports it (None: declared, and not imported): {different}'
        )


def test_mathematics_has_no_clock_and_no_threads():
    """What these rooms need to know of time is an argument."""
    violations = [
        f'{path} imports {name}'
        for _, path, names in files()
        if any(f'/{part}/' in path.as_posix() for part in WITHOUT_CLOCK)
        for name in names & {'time', 'threading', 'datetime'}
    ]
    assert not violations, '\n'.join(violations)


def test_no_node_imports_another():
    """Only the module that composes them does, and the one that prints what they report."""
    nodes = {f'{PACKAGE}.nodes.{name}' for name in NODES}
    violations = [
        f'{path} imports {name}'
        for room, path, names in files()
        if room == 'nodes' and path.stem not in ('master', 'console')
        for name in names & (nodes - {f'{PACKAGE}.nodes.{path.stem}'})
    ]
    assert not violations, '\n'.join(violations)


def test_a_mark_that_chooses_the_files_of_a_tier_is_in_the_file_of_its_test(misplaced):
    """Of all tests that were collected with this one: `pytest_ignore_collect` reads the files."""
    assert misplaced == []
