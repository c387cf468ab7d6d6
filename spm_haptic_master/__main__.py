"""Start an executable by name: python -m spm_haptic_master NAME [--ros-args ...]."""

from __future__ import annotations

from importlib import import_module
import signal
import sys

EXECUTABLES = {
    'master': 'driver, forward model and diagnostics in one process',
    'encoder_driver': 'four joint angles from CAN, a recording or a simulation',
    'fkm': "joint angles in, the platform's orientation out",
    'diagnostics': 'nearness of a singularity',
    'benchmark': 'latency, CPU and loss of the nodes beside those of a bare relay',
    'recorder': 'orientations and joint angles into CSV files',
}
# Those that need no ROS.
TOOLS = {
    'can_scan': 'what is on the CAN bus, and what of it is missing or unexpected',
    'calibrate': 'zero counts and noise of the encoders, from a known pose',
    'sim_bus': 'four simulated CANopen encoders on a CAN bus, with faults on request',
    'validate': 'recorded orientations against motion capture',
}


def main(argv: list[str] | None = None) -> int:
    """Run the executable that the first argument names; 2 if it names none."""
    argv = sys.argv if argv is None else argv
    if len(argv) < 2 or argv[1] not in EXECUTABLES | TOOLS:
        print('usage: python -m spm_haptic_master NAME [--ros-args ...], NAME one of\n'
              + '\n'.join(f'  {name:16}{what}' for name, what in (EXECUTABLES | TOOLS).items()),
              file=sys.stderr)
        return 2
    # Until the program has handlers of its own a signal simply ends it: Python's KeyboardInterrupt
    # can be lost in the middle of an import. Also where a shell has SIGINT ignored by what it runs
    # in the background.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    room = 'tools' if argv[1] in TOOLS else 'nodes'
    return import_module(f'spm_haptic_master.{room}.{argv[1]}').main(argv[1:])


if __name__ == '__main__':
    sys.exit(main())
