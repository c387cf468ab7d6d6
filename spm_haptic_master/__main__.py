# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Start of every executable, before the libraries are imported: `python -m spm_haptic_master NAME`.

Each is a function of this module besides: `ros2 run spm_haptic_master master` calls `master`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib import import_module
import signal
import sys

from spm_haptic_master.executables import EXECUTABLES
from spm_haptic_master.standard_streams import keep_open

# Module of rclpy that the nodes need, and the first version of rclpy for ROS 2 Jazzy with it.
EVENTS_EXECUTOR, RCLPY_MINIMUM = 'rclpy.experimental', '7.1.4'
# Remedies for missing modules.
REMEDIES = {
    **dict.fromkeys(
        ('rclpy', 'diagnostic_msgs', 'geometry_msgs', 'rcl_interfaces', 'sensor_msgs', 'std_msgs'),
        'source /opt/ros/jazzy/setup.bash (sudo apt install ros-jazzy-ros-base); without ROS 2, '
        "in a virtual environment: pip install '.[ros]'",
    ),
    'can': 'sudo apt install python3-can',
    'numpy': 'sudo apt install python3-numpy',
    'viser': (
        "python3 -m venv --system-site-packages ~/view && ~/view/bin/pip install 'viser<2' "
        'websockets msgspec; then ~/view/bin/python -m spm_haptic_master view'
    ),
    'yaml': 'sudo apt install python3-yaml',
}


def start(name: str, argv: list[str] | None = None) -> int:
    """Run one of EXECUTABLES with `argv` (by default sys.argv); return its exit code."""
    # Until the executable installs its own handler, SIGINT ends it by default: a KeyboardInterrupt
    # can be lost during an import, or end it with a traceback. A shell ignores SIGINT for its
    # background jobs.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    keep_open()
    module, _ = EXECUTABLES[name]
    try:
        main = import_module(f'spm_haptic_master.{module}').main
    except ImportError as error:
        remedy = _remedy(error)
        if remedy is None:
            raise
        print(f'{name}: {remedy}', file=sys.stderr)
        return 1
    code: int = main(argv)
    return code


def _remedy(error: ImportError) -> str | None:
    """Return the missing module and its source, None for a module of this package."""
    missing = error.name or ''
    package = missing.partition('.')[0]
    if missing.startswith(EVENTS_EXECUTOR):
        # Imported here: an interrupted import before `start` would print a traceback.
        from importlib import metadata

        try:
            version = metadata.version('rclpy')
        except metadata.PackageNotFoundError:
            version = 'of an unknown version'
        return (
            f'rclpy {version} is too old: {RCLPY_MINIMUM} or newer is needed; '
            'sudo apt update && sudo apt install ros-jazzy-rclpy'
        )
    remedy = REMEDIES.get(package)
    return remedy and f'the Python module {package} is missing: {remedy}'


def __getattr__(name: str) -> Callable[[], int]:
    """Return what starts an executable: the entry points are functions of this module."""
    if name in EXECUTABLES:
        return partial(start, name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def main() -> int:
    """Run the executable that the first argument names; return its exit code, 2 without one."""
    argv = sys.argv[1:]
    if argv and argv[0] in EXECUTABLES:
        return start(argv[0], argv)
    lines = [f'  {name:16}{description}' for name, (_, description) in EXECUTABLES.items()]
    print(
        'usage: python -m spm_haptic_master NAME [--ros-args ...], NAME one of',
        *lines,
        sep='\n',
        file=sys.stderr,
    )
    return 2


if __name__ == '__main__':
    sys.exit(main())
