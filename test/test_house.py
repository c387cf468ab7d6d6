# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which room may import which: downwards only, and each room only what its purpose needs.

And the tests' tiers: what starts a process is marked.
"""

import ast
from functools import cache
from pathlib import Path
import re
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
    'benchmark': {'ros', 'encoders', 'kinematics'},
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
    'benchmark': {'numpy', 'matplotlib', 'rclpy', 'diagnostic_msgs', 'geometry_msgs',
                  'sensor_msgs', 'std_msgs', 'std_srvs'},
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
# What starts a process in a test: modules, helpers, and fixtures of conftest.
STARTERS = {'subprocess', 'multiprocessing', 'pty', 'Program', 'start_program', 'start_command',
            'rig_experiment.run', 'rig_experiment.calibrate', 'rig_figures.entries', 'os.fork',
            'os.execve', 'os.system'}
FIXTURES = {'start', 'start_python'}
# Marks that keep a test out of `make quick`.
MARKS = {'process', 'packaging'}


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
    """Only the module that composes the nodes, and their display, import more than one."""
    violations = []
    for room, path, names in files():
        if room != 'nodes' or path.stem in {'master', 'console'}:
            continue
        known = {name.split('.')[2] for name in names if name.startswith(f'{PACKAGE}.nodes.')}
        violations += [f'{path} imports {name}' for name in known & (NODES - {path.stem})]
    assert not violations, '\n'.join(violations)


def test_a_second_has_one_definition():
    """Nanoseconds per second are `SECOND` of `timing`."""
    found = [str(path) for _, path, _ in files()
             if re.search(r'^[A-Z_]+ = (1_000_000_000|10 ?\*\* ?9)$',
                          (ROOT / path).read_text(), re.MULTILINE)]
    assert found == [f'{PACKAGE}/timing.py']


def names_in(node: ast.AST) -> set[str]:
    """Return the names that a definition uses, also dotted ones, and its own fixtures."""
    found = set()
    for each in ast.walk(node):
        if isinstance(each, ast.Name) and each.id not in FIXTURES:
            found.add(each.id)
        elif isinstance(each, ast.Attribute) and isinstance(each.value, ast.Name):
            found.add(f'{each.value.id}.{each.attr}')
    if isinstance(node, ast.FunctionDef) and (
            node.name.startswith('test') or 'pytest.fixture' in text_of(node.decorator_list)):
        found |= {argument.arg for argument in node.args.args}
    return found


def text_of(nodes: list[ast.expr]) -> str:
    """Return expressions as text."""
    return ' '.join(map(ast.unparse, nodes))


def is_marked(nodes: list[ast.expr]) -> bool:
    """Return whether a mark of MARKS is among expressions."""
    return any(f'pytest.mark.{mark}' in text_of(nodes) for mark in MARKS)


def unmarked_tests(path: Path) -> list[str]:
    """Return the tests of a module that start processes, themselves or below, without a mark."""
    tree = ast.parse(path.read_text())
    if is_marked([node.value for node in tree.body if isinstance(node, ast.Assign)
                  and ast.unparse(node.targets[0]) == 'pytestmark']):
        return []
    definitions = {node.name: node for node in tree.body
                   if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    used = {name: names_in(node) for name, node in definitions.items()}
    starters = STARTERS | FIXTURES
    while new := {name for name in used if used[name] & starters} - starters:
        starters |= new
    return [f'{path.name}: {name}' for name, node in definitions.items()
            if name.startswith('test') and name in starters
            and not is_marked(node.decorator_list)]


def test_what_starts_a_process_is_marked():
    """Such tests are of `make test` only: each has the mark `process` or `packaging`."""
    unmarked = [test for path in sorted((ROOT / 'test').rglob('test_*.py'))
                for test in unmarked_tests(path)]
    assert not unmarked, '\n'.join(unmarked)


def test_an_unmarked_test_is_found(tmp_path):
    """Directly, through a helper or through a fixture; but not what is marked."""
    path = tmp_path / 'test_some.py'
    path.write_text("""
import subprocess
import pytest

def helper():
    return subprocess.run(['true'])

@pytest.fixture
def running(start):
    return start('fkm')

def test_by_fixture(running): pass
def test_by_helper(): helper()
def test_pure(): pass
@pytest.mark.process
def test_marked(running): pass
@pytest.mark.parametrize('x', [1])
@pytest.mark.packaging
def test_packaging(x): subprocess.run([])
""")
    assert unmarked_tests(path) == [
        'test_some.py: test_by_fixture', 'test_some.py: test_by_helper']
    path.write_text('import pytest\npytestmark = pytest.mark.process\n' + path.read_text())
    assert unmarked_tests(path) == []


def test_names_of_test_modules_are_unique():
    """Tests of all rooms are imported by their file's name."""
    names = [path.name for path in (ROOT / 'test').rglob('*.py') if path.name != 'conftest.py']
    assert sorted({name for name in names if names.count(name) > 1}) == []
