# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live status on a terminal, as an emulator shows it, and its words."""

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import termios
import time
from types import SimpleNamespace

from harness import environment, ROOT, SIM
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import executable
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes import master as console_module
from spm_haptic_master.nodes.master import AMBER, Console, PLAIN, RED, Row, status_lines
from spm_haptic_master.ros.diagnostic_status import OK
from spm_haptic_master.supervision.orientation_state import read_state
from std_msgs.msg import String

pyte = pytest.importorskip('pyte', reason='pyte is not installed (extra test)')

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
TITLE = 'haptic master, source sim (Ctrl-C ends)'
# The lines of a status with an orientation.
BLOCK = (
    r'haptic master, source (sim|can) \(Ctrl-C ends\)',
    r'  the simulated motion crosses the singularity on purpose',
    r'  state             healthy',
    r'  orientation       psi +[-\d.]+ theta +[-\d.]+ phi +[-\d.]+ deg',
    r'  protection level  [\d.]+ deg',
    r'  parity            [-+][\d.]+ sigma',
    r'  singularity       [a-z ;]+',
    r'                    at \[#*-*\] far',
    r'  dexterity         [\d.]+ \(3 sensors\), [\d.]+ \(4 sensors\)',
    r'  rates             joints \d+ Hz, orientation \d+ Hz',
    r'  latency           p50 \d+ us, p99 \d+ us',
)
LOGGED = re.compile(r'\[(ERROR|WARN|INFO)\] \[[\d.]+\] \[\w+\]: ')
# A line more where there is a caution: Fig. 9 begins where the others cannot check th3A.
# What does not fit into it is in lines below it.
CAUTION = re.compile(r'  caution           \S.*| {20}(?!at \[)\S.*')


class Terminal:
    """A program on a pseudo-terminal of a size, and what an emulator shows of it."""

    def __init__(self, command, columns, lines):
        self._emulator, self._device = pty.openpty()
        self._screen = pyte.HistoryScreen(columns, lines, history=10_000)
        self._stream = pyte.ByteStream(self._screen)
        # All that the program printed.
        self.raw = b''
        self._set_size(columns, lines)
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=environment(TERM='xterm'), stdin=self._device,
            stdout=self._device, stderr=self._device, start_new_session=True)

    def _set_size(self, columns, lines):
        fcntl.ioctl(self._device, termios.TIOCSWINSZ, struct.pack('HHHH', lines, columns, 0, 0))

    def resize(self, columns, lines):
        """Give the window another size; as xterm, a lower one loses lines below the cursor."""
        self.read(0.0)
        self._set_size(columns, lines)
        screen, row = self._screen, self._screen.cursor.y
        removed = max(0, screen.lines - lines)
        above = max(0, row + 1 - lines)
        if removed > above:
            screen.cursor_position(1, 1)
            screen.insert_lines(removed - above)
        screen.resize(lines, columns)
        screen.cursor_position(row - above + 1, 1)

    def print_to(self, text):
        """Print as another library of the program does."""
        os.write(self._device, text.encode())

    def read(self, seconds):
        """Show what is printed within some seconds."""
        end = time.monotonic() + seconds
        while True:
            left = max(0.0, end - time.monotonic())
            if not select.select([self._emulator], [], [], left)[0]:
                return
            data = os.read(self._emulator, 1 << 16)
            self.raw += data
            self._stream.feed(data)

    def read_until(self, condition, seconds):
        """Show what is printed until a condition holds; False if it did not in time."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self.read(0.1)
        return True

    @property
    def shown(self):
        """Return the lines on the screen."""
        return [line.rstrip() for line in self._screen.display]

    @property
    def text(self):
        """Return the lines on the screen and those that have left it upwards."""
        above = [''.join(line[column].data for column in range(self._screen.columns)).rstrip()
                 for line in self._screen.history.top]
        return above + self.shown

    @property
    def cursor(self):
        """Return column and line of the cursor."""
        return self._screen.cursor.x, self._screen.cursor.y

    def end(self, seconds):
        """Interrupt the program, show its end and return its exit code."""
        self._process.send_signal(signal.SIGINT)
        self.read_until(lambda: self._process.poll() is not None, seconds)
        self.read(0.1)
        return self._process.wait(seconds)

    def close(self):
        """Kill the program and close the terminal."""
        self._process.kill()
        self._process.wait()
        os.close(self._emulator)
        os.close(self._device)


def block_of(lines):
    """Return the part of some lines from the title on, without the empty ones below."""
    found = [number for number, line in enumerate(lines) if line.startswith('haptic')]
    assert len(found) == 1, '\n'.join(lines)
    block = lines[found[0]:]
    while block and not block[-1]:
        block.pop()
    return block


def is_whole(block):
    """Return whether a block is a status with an orientation, with or without a caution."""
    lines = [line for line in block if not CAUTION.fullmatch(line)]
    return len(lines) == len(BLOCK) and all(map(re.fullmatch, BLOCK, lines))


def heights(lines):
    """Return the numbers of lines that a status may have on a terminal."""
    return {min(len(BLOCK) + more, lines - 1) for more in range(12)}


@pytest.fixture
def screen():
    """Run a simulated master on a terminal."""
    screen = Terminal(executable('master', parameters={**SIM, 'rate': 250.0}), 80, 24)
    yield screen
    screen.close()


@pytest.mark.process
def test_status_and_log_stay_in_their_places_whatever_the_size(screen, observer):
    assert screen.read_until(lambda: screen.raw.count(b'psi') > 6, PATIENCE)
    # A busy machine may withhold orientations meanwhile; the status then has another line.
    assert screen.read_until(
        lambda: is_whole(block_of(screen.text)), PATIENCE), screen.text
    assert b'\x1b[32mhealthy\x1b[0m' in screen.raw
    # The cursor waits on an empty line above it.
    column, line = screen.cursor
    assert (column, screen.shown[line], screen.shown[line + 1]) == (0, '', TITLE)
    # Another size, and what other libraries print, leave no ghosts.
    for columns, lines in (50, 20), (9, 3), (200, 60), (80, 5), (120, 24):
        screen.print_to(f'a library prints at {columns} {lines}\n')
        screen.read(0.4)
        screen.resize(columns, lines)
        seen = screen.raw.count(b'haptic')
        assert screen.read_until(
            lambda seen=seen: screen.raw.count(b'haptic') > seen + 1, PATIENCE)
        block = block_of(screen.shown)
        assert block[0] == TITLE[:columns].rstrip() and len(block) in heights(lines)
        # Each line of the screen is one of the status: none is wrapped.
        assert all(line.startswith('  ') for line in block[1:])
    # The log is above it, in whole lines.
    faults = observer.node.create_publisher(String, 'simulation/fault', 1)
    assert observer.spin_until(faults.get_subscription_count, PATIENCE)
    for fault, words in (('dropout:joint_3a', 'silent: no joint samples'), ('', 'healthy')):
        faults.publish(String(data=fault))
        assert screen.read_until(lambda words=words: any(
            LOGGED.sub('', line) == words for line in screen.text if LOGGED.match(line)),
            PATIENCE), screen.text
    assert screen.end(PATIENCE) == 0
    first = next(number for number, line in enumerate(screen.text)
                 if LOGGED.sub('', line) == 'silent: no joint samples')
    assert all(LOGGED.match(line)
               for line in screen.text[first:screen.text.index(TITLE)] if line)
    # The last status stays, and what comes next is printed below it.
    assert block_of(screen.text)[-1].startswith('  latency')
    assert screen.shown[screen.cursor[1] - 1].startswith('  latency')
    assert screen.cursor[0] == 0


@pytest.mark.parametrize('term', ['dumb', 'xterm'])
def test_a_terminal_without_controls_gets_lines(monkeypatch, term):
    reading, device = os.openpty()
    monkeypatch.setenv('TERM', term)
    monkeypatch.setattr(console_module, 'STANDARD_OUTPUT', device)
    monkeypatch.setattr(console_module.node_log, 'attach', lambda *_, **__: None)
    parts = parts_of()
    found = Console(parts.driver, parts.fkm, parts.diagnostics)
    shown = b''
    if term == 'xterm':
        found.put('a line of the log')
        while b'a line of the log' not in shown:
            shown += os.read(reading, 10_000)
    found.close(10.0)
    while select.select([reading], [], [], 0.2)[0]:
        shown += os.read(reading, 10_000)
    assert shown.count(b'a line of the log') == (term == 'xterm')
    assert (b'\x1b' in shown) == (term == 'xterm')
    assert shown.startswith(b'haptic master, source can (Ctrl-C ends)\r\n') == (term == 'dumb')
    assert b'latency' in shown
    os.close(reading)
    os.close(device)


def parts_of(state='healthy', encoders='publishing', dexterity=0.15, pose=(0.0, 0.0, 0.0),
             force=None, caution=''):
    """Return driver, fkm and diagnostics, as far as a console reads them."""
    meter = SimpleNamespace(rate=lambda: 1000.0, percentiles=lambda *_: (90.0, 200.0))
    quaternion = tuple(quaternion_from_matrix(matrix_from_zxz(*np.radians(pose))).tolist())
    fkm = SimpleNamespace(state=read_state(state), quaternion=quaternion,
                          status=SimpleNamespace(caution=caution),
                          protection_level=0.01, force_state=force,
                          latency_status=SimpleNamespace(parity=0.1, published=meter,
                                                         latency=meter))
    driver = SimpleNamespace(state=encoders, source_name='can', published=meter)
    diagnostics = SimpleNamespace(
        state='clear of singularities', levels=SimpleNamespace(level=OK), sensors=4,
        dexterities=None if dexterity is None else SimpleNamespace(three=dexterity, every=0.4))
    return SimpleNamespace(driver=driver, fkm=fkm, diagnostics=diagnostics)


def console(**given):
    """Return a console without its thread."""
    found, parts = Console.__new__(Console), parts_of(**given)
    found._driver, found._fkm, found._diagnostics = parts.driver, parts.fkm, parts.diagnostics
    return found


def rows_of(**given):
    """Return the lines of a status below the title."""
    return status_lines([], console(**given)._rows(), 80, 23, False)


def test_all_rows_of_a_status_with_force_feedback_and_cautions():
    """The bar is that of the page of `view`."""
    assert rows_of(encoders='joint_1b: EMCY 0x5000', caution='joint_3a unchecked',
                   force=FORCE_STATES['holding'], pose=(130.0, 50.0, 30.0)) == [
        '  state             healthy',
        '  caution           joint_3a unchecked',
        '  caution           encoders: joint_1b: EMCY 0x5000',
        '  force             holding',
        '  orientation       psi  130.000 theta  50.000 phi   30.000 deg',
        '  protection level  0.57 deg',
        '  parity            +0.1 sigma',
        '  singularity       clear of singularities',
        '                    at [###############-----] far',
        '  dexterity         0.1500 (3 sensors), 0.4000 (4 sensors)',
        '  rates             joints 1000 Hz, orientation 1000 Hz',
        '  latency           p50 90 us, p99 200 us']


def test_without_an_orientation_the_state_and_what_the_driver_knows_have_rows():
    assert rows_of(state='starting', encoders='no frames on socketcan can0', dexterity=None) == [
        '  state             starting',
        '  caution           encoders: no frames on socketcan can0',
        '  singularity       unknown: clear of singularities',
        '  rates             joints 1000 Hz, orientation 1000 Hz',
        '  latency           p50 90 us, p99 200 us']


def test_a_line_for_a_log_has_all_in_it():
    assert console(encoders='', caution='joint_3a unchecked', state='degraded: joint_3b missing',
                   force=FORCE_STATES['holding'])._line() == (
        'source can, state degraded: joint_3b missing, caution joint_3a unchecked, force holding, '
        'orientation psi    0.000 theta   0.000 phi    0.000 deg, protection level 0.57 deg, '
        'parity +0.1 sigma, singularity clear of singularities, '
        'dexterity 0.1500 (3 sensors), 0.4000 (4 sensors), '
        'rates joints 1000 Hz, orientation 1000 Hz, latency p50 90 us, p99 200 us\n')


@pytest.mark.parametrize(('eta', 'expected'), [(0.0, 0), (0.1, 10), (7.0, 20)])
def test_the_bar_is_empty_at_the_singularity_as_on_the_page(eta, expected):
    (found,) = re.findall(r'at \[(#*)-*\] far', '\n'.join(rows_of(dexterity=eta)))
    assert len(found) == expected


@pytest.mark.parametrize('coloured', [True, False])
@pytest.mark.parametrize(('width', 'height'), [(0, 23), (9, 2), (30, 0), (80, 2), (50, 23),
                                               (200, 23)])
def test_a_status_fits_any_terminal_and_shows_all_where_there_is_room(width, height, coloured):
    long = 'silent: joint_1a: no answer, is the bus powered, and are the node ids the right ones?'
    rows = [Row('state', long, RED), Row('caution', 'no \x1b[2J of\tcan0\n', AMBER)]
    found = status_lines(['title of the status'], rows, width, height, coloured)
    bare = [re.sub(r'\x1b\[\d+m', '', line) for line in found]
    assert len(found) <= height and all(len(line) <= width for line in bare)
    assert '\x1b' not in ''.join(found if not coloured else bare)
    if height == 23 and width >= 50:
        assert bare[0] == 'title of the status'
        assert bare[-1] == '  caution           no ?[2J of?can0?'
        assert ' '.join(' '.join(bare[1:-1]).split()) == f'state {long}'
        # A row that goes on has no name, and the colour of that above.
        assert all(line.startswith(' ' * 20) for line in bare[2:-1])
        assert all((line.count(RED), line.endswith(PLAIN)) == (coloured, coloured)
                   for line in found[1:-1])
