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
    'validation': {'encoders', 'kinematics'},
    'calibration': {'validation', 'encoders', 'parameters', 'kinematics'},
    'teleoperation': {'supervision', 'kinematics'},
    'description': {'kinematics'},
    'ros': {'parameters', 'kinematics'},
    'nodes': {'ros', 'teleoperation', 'calibration', 'force', 'supervision', 'drives',
              'encoders', 'simulation', 'parameters', 'kinematics'},
    'benchmark': {'ros', 'kinematics'},
    'view': {'nodes', 'ros', 'description', 'simulation', 'force', 'supervision', 'parameters',
             'kinematics'},
    'tools': {'benchmark', 'nodes', 'description', 'validation', 'calibration',
              'simulation', 'drives', 'encoders', 'force', 'supervision', 'parameters',
              'kinematics'},
    'paper': {'validation', 'description', 'simulation', 'parameters', 'kinematics', 'benchmark'},
    'study': {'paper', 'validation', 'description', 'force', 'supervision', 'parameters',
              'kinematics'},
}
# What each may import from outside, beside the standard library; '' is the top level.
OUTSIDE = {
    '': set(),
    'kinematics': {'numpy'},
    'parameters': {'yaml'},
    'supervision': {'numpy'},
    'force': {'numpy'},
    'encoders': {'can', 'canopen', 'numpy'},
    'drives': {'can'},
    'simulation': {'can'},
    'calibration': {'numpy', 'matplotlib', 'yaml'},
    'validation': {'numpy', 'matplotlib', 'rosbag2_py', 'rosbags', 'yaml'},
    'teleoperation': set(),
    'description': {'numpy'},
    'ros': {'rclpy', 'rcl_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'sensor_msgs'},
    'nodes': {'rclpy', 'crtk_msgs', 'rcl_interfaces', 'diagnostic_msgs', 'geometry_msgs',
              'sensor_msgs', 'std_msgs', 'std_srvs', 'tf2_msgs'},
    'benchmark': {'numpy', 'rclpy', 'diagnostic_msgs', 'geometry_msgs',
                  'sensor_msgs'},
    'view': {'numpy', 'rclpy', 'viser', 'websockets', 'msgspec', 'diagnostic_msgs',
             'geometry_msgs', 'rcl_interfaces', 'sensor_msgs', 'std_msgs'},
    'tools': {'numpy', 'can'},
    'paper': {'numpy', 'matplotlib', 'mujoco'},
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
    for path in sorted(path for folder in (PACKAGE, *NOT_INSTALLED)
                       for path in (ROOT / folder).rglob('*.py')):
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


def inner(names: set[str]) -> set[str]:
    """Return the first part below the package of the names that are the package's own."""
    return {name.split('.')[1] for name in names if name.startswith(f'{PACKAGE}.')} \
        | {name.split('.')[0] for name in names} & NOT_INSTALLED


def test_every_room_is_declared_above_those_that_it_imports():
    """ROOMS is in an order in which each room rests on earlier ones only: there is no circle."""
    assert {room for room, _, _ in files()} == {'', *ROOMS} == set(OUTSIDE)
    order = list(ROOMS)
    assert [(room, other) for room, others in ROOMS.items() for other in others
            if order.index(other) >= order.index(room)] == []


def test_imports_are_those_declared():
    """A room imports itself, the rooms declared for it, top-level modules, and its libraries."""
    violations = []
    for room, path, names in files():
        allowed = {*TOP_LEVEL, *({room, *ROOMS[room]} if room else ())}
        libraries = {PACKAGE, *NOT_INSTALLED, *OUTSIDE[room], *sys.stdlib_module_names}
        violations += [f'{path} imports {name}' for name in inner(names) - allowed]
        violations += [f'{path} imports {name}' for name in names
                       if name.split('.')[0] not in libraries]
    assert not violations, '\n'.join(violations)


def test_what_is_declared_is_imported():
    """An import that is gone goes from ROOMS and from OUTSIDE, and so from the drawing."""
    used = {room: set() for room in ROOMS}
    for room, _, names in files():
        if room:
            used[room] |= inner(names) | {name.split('.')[0] for name in names}
    unused = [f'{room}: {name}' for room, names in used.items()
              for name in (ROOMS[room] | OUTSIDE[room]) - names]
    assert not unused, '\n'.join(unused)


def test_mathematics_has_no_clock_and_no_threads():
    """What these rooms need to know of time is an argument."""
    violations = [f'{path} imports {name}' for _, path, names in files()
                  if any(f'/{part}/' in path.as_posix() for part in WITHOUT_CLOCK)
                  for name in names & {'time', 'threading', 'datetime'}]
    assert not violations, '\n'.join(violations)


def test_no_node_imports_another():
    """Only the module that composes them does."""
    violations = []
    for room, path, names in files():
        if room != 'nodes' or path.stem == 'master':
            continue
        known = {name.split('.')[2] for name in names if name.startswith(f'{PACKAGE}.nodes.')}
        violations += [f'{path} imports {name}' for name in known & (NODES - {path.stem})]
    assert not violations, '\n'.join(violations)
