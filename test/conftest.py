# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fixtures of several rooms; every test run has a DDS domain and a CAN bus of its own."""

from contextlib import closing, contextmanager, ExitStack
from functools import cache
import gc
import os
from pathlib import Path
import signal
import sys
import threading
import uuid

from benchmarks.pipeline import child_process
import can
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / 'test'))
pytest.register_assert_rewrite('recorded_text')
os.environ.update(child_process.private_environment())

# As from a terminal; what a shell runs in the background, and all it starts, would ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config):
    """Have Ctrl-C end a run of several workers at once, where no test starts a process."""
    is_controller = getattr(config.option, 'numprocesses', None)
    if is_controller and 'not process' in config.option.markexpr:
        signal.signal(signal.SIGINT, end_at_once)


def end_at_once(number, frame):
    """End this process and its workers, which may be in the middle of a long computation."""
    children = Path(f'/proc/self/task/{os.getpid()}/children').read_text().split()
    for child in children:
        os.kill(int(child), signal.SIGKILL)
    os._exit(128 + number)


@pytest.hookimpl(hookwrapper=True)
def pytest_collection():
    """Look for no garbage in what is imported: neither meanwhile, nor again during each test."""
    gc.disable()
    yield
    gc.freeze()
    gc.enable()


# Marks of the tests of few files: the tiers of `make test` that ask for one import these alone.
RARE_MARKS = 'process', 'alone'


def asked_for(expression):
    """Return the rare marks that every test has which an expression of marks selects."""
    return set() if ' or ' in expression else {*RARE_MARKS} & {*expression.split(' and ')}


@cache
def marks_in(path):
    """Return the rare marks that a file has somewhere."""
    text = path.read_text()
    return {mark for mark in RARE_MARKS if f'mark.{mark}' in text}


def pytest_ignore_collect(collection_path, config):
    """Import no file in which nothing is asked for: most of a start is the import of tests."""
    is_file = collection_path.suffix == '.py' and collection_path.is_file()
    if is_file and not asked_for(config.option.markexpr) <= marks_in(collection_path):
        return True


# Tests with a rare mark from another file than their own.
MISPLACED = pytest.StashKey[list[str]]()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Find the tests that would not be seen where their mark is asked for, of all tests."""
    config.stash[MISPLACED] = [
        f'{item.nodeid}: {mark.name}'
        for item in items
        for mark in item.iter_markers()
        if mark.name in RARE_MARKS and mark.name not in marks_in(item.path)
    ]


@pytest.fixture
def misplaced(pytestconfig):
    """Return the tests whose rare mark is not in their own file, of those that were collected."""
    return pytestconfig.stash[MISPLACED]


@pytest.fixture(autouse=True)
def handlers():
    """Leave the handling of signals as it was."""
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGALRM
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.fixture
def stack():
    """Give a stack of what ends with the test."""
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def start(stack):
    """Start executables of the package; those still running at the test's end are stopped."""
    from harness import start_program

    return lambda *args, **kwargs: stack.enter_context(start_program(*args, **kwargs))


@pytest.fixture
def start_python(stack):
    """Start Python with arguments; what still runs at the test's end is killed."""
    from harness import start_command

    def start(*args, **kwargs):
        program = start_command([sys.executable, *args], **kwargs)
        stack.callback(program.kill)
        return program

    return start


@pytest.fixture
def observer(stack):
    """Give a node that collects messages."""
    from harness import Observer

    return stack.enter_context(closing(Observer()))


@pytest.fixture
def channel():
    """Give the channel of a virtual bus of this test's own."""
    return uuid.uuid4().hex


@pytest.fixture
def encoders(channel):
    """Return what runs simulated encoders in a thread, still or with SYNC each some s."""
    from encoder_frames import make_layouts, values
    from spm_haptic_master.simulation.bus_runner import BusRunner
    from spm_haptic_master.simulation.device_quirks import parse_quirk
    from spm_haptic_master.simulation.noisy_motion import make_motion
    from spm_haptic_master.simulation.simulated_bus import SimulatedBus
    from spm_haptic_master.simulation.simulated_nodes import NodeOptions
    from spm_haptic_master.timing import DeadlineGrid

    @contextmanager
    def run(factory=False, sync=None, pose=None, quirks=(), seed=1, **layout):
        motion = {'sim__trajectory': 'fixed', 'sim__pose_deg': pose} if pose else {}
        settings = values(**layout)
        end = threading.Event()
        sync_id = settings['encoders.sync_id'] or None
        period = 1.0 / settings['rate']
        made = SimulatedBus(
            make_layouts(settings),
            settings['encoders.node_id'],
            make_motion(values('sim', **motion)),
            (),
            seed,
            NodeOptions(
                synchronised=sync_id is not None,
                factory=factory,
                period=period,
            ),
            tuple(map(parse_quirk, quirks)),
        )
        if sync_id is None:
            sync = period
        with can.Bus(interface='virtual', channel=channel) as bus:
            runner = BusRunner(bus, made, sync_id, DeadlineGrid(sync) if sync else None)

            def loop():
                runner.boot()
                while not end.is_set():
                    runner.step()

            thread = threading.Thread(target=loop)
            thread.start()
            try:
                yield made.nodes
            finally:
                end.set()
                thread.join()

    return run


@pytest.fixture
def few_guesses(monkeypatch):
    """Have the search for zeros guess less often: of a good motion one in five is right."""
    from spm_haptic_master.calibration.motion import zero_search

    monkeypatch.setattr(zero_search, 'GUESSES', 12)
    monkeypatch.setattr(zero_search, 'MORE_GUESSES', 48)


@pytest.fixture(scope='session')
def bus_channel():
    """Give the channel of this run's own CAN bus between processes."""
    return child_process.bus_channel()


def pytest_terminal_summary(terminalreporter):
    """Print how many measurements a busy machine has prevented."""
    from disturbance import number_of_skips

    skipped = number_of_skips(terminalreporter.stats.get('skipped', ()))
    terminalreporter.write_line(f'skipped because the machine was too busy: {skipped}')
