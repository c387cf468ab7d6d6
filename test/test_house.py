"""Who may import whom: downwards only, and no room reaches past its walls."""

import ast
from pathlib import Path
import sys

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'spm_haptic_master'
NAME = PACKAGE.name

# Each room's own modules it may import, beside itself and the package's top level.
ROOMS = {
    'kinematics': set(),
    'encoders': {'kinematics'},
    'tools': {'encoders', 'kinematics'},
    'paper': {'tools', 'encoders', 'kinematics'},
    'nodes': {'encoders', 'kinematics'},
}
# What each room may import from outside, beside the standard library.
OUTSIDE = {
    'kinematics': {'numpy'},
    'encoders': {'numpy', 'can', 'yaml'},
    'tools': {'numpy', 'can', 'yaml', 'matplotlib', 'mcap', 'mcap_ros2'},
    'paper': {'numpy', 'matplotlib', 'mujoco', 'can'},
    'nodes': {'numpy', 'yaml', 'rclpy', 'ament_index_python', 'rcl_interfaces',
              'diagnostic_msgs', 'geometry_msgs', 'sensor_msgs', 'std_msgs', 'matplotlib'},
}
# What the top level may use: no ROS, no bus.
TOP_LEVEL = {'exceptions', 'settings', 'manipulator', 'meters'}


def imports(path: Path) -> set[str]:
    """Return the dotted names that a file imports anywhere, relative ones made absolute."""
    found = set()
    package = (NAME, *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[:len(package) - node.level + 1] if node.level else ()
            base = '.'.join((*above, *filter(None, [node.module])))
            found |= {base, *(f'{base}.{alias.name}' for alias in node.names)} \
                if base == NAME else {base}
    return found


FILES = sorted(path for path in PACKAGE.rglob('*.py'))


def test_every_room_is_known():
    rooms = {path.relative_to(PACKAGE).parts[0] for path in FILES
             if len(path.relative_to(PACKAGE).parts) > 1}
    assert rooms <= set(ROOMS)
    assert {'kinematics', 'encoders', 'nodes'} <= rooms


@pytest.mark.parametrize('path', FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_run_downwards_only(path):
    room, *rest = path.relative_to(PACKAGE).parts
    if not rest:
        room = None
    for name in imports(path):
        top, *inner = name.split('.')
        if top == NAME:
            if not inner or inner[0] in TOP_LEVEL:
                continue
            if room is None:
                # manipulator.py makes a Geometry; nothing at the top reaches into other rooms.
                assert inner[0] == 'kinematics', f'{path.name} imports {name}'
            else:
                assert inner[0] == room or inner[0] in ROOMS[room], f'{path.name} imports {name}'
        elif top not in sys.stdlib_module_names:
            assert room is not None and top in OUTSIDE[room], f'{path.name} imports {name}'


def test_no_node_imports_another():
    """Only what starts them together, and shows them, knows more than one node."""
    nodes = {'encoder_driver', 'fkm', 'diagnostics', 'master'}
    for path in (PACKAGE / 'nodes').glob('*.py'):
        if path.stem in {'master', 'status'}:
            continue
        known = {name.split('.')[2] for name in imports(path) if name.startswith(f'{NAME}.nodes.')}
        assert not known & (nodes - {path.stem}), f'{path.name} imports another node'
