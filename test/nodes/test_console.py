# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live status on a terminal, as an emulator shows it, and its words."""

import os
import re
import select
from types import SimpleNamespace

from harness import SIM
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import executable
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes import console as console_module
from spm_haptic_master.nodes.console import Console
from spm_haptic_master.nodes.status_rows import bar, Colour, fitted, PLAIN, Row, status_lines
from spm_haptic_master.ros.diagnostic_status import OK
from spm_haptic_master.supervision.orientation_state import read_state
from std_msgs.msg import String
from terminal import Terminal

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
    r'  singularity       (at \[#*-*\] far )?[a-z ;]+',
    r'  dexterity         [\d.]+ \(3 sensors\), [\d.]+ \(4 sensors\)',
    r'  rates             joints \d+ Hz, orientation \d+ Hz',
    r'  latency           p50 \d+ us, p99 \d+ us',
)
LOGGED = re.compile(r'\[(ERROR|WARN|INFO)\] \[[\d.]+\] \[\w+\]: ')
# A line more where there is a caution: Fig. 9 begins where the others cannot check th3A.
# What does not fit into it is in lines below it.
CAUTION = re.compile(r'  caution           \S.*| {20}\S.*')


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
    return {min(len(BLOCK) + caution, lines - 1) for caution in range(8)}


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


@pytest.mark.parametrize(('text', 'width', 'expected'), [
    ('haptic', 80, 'haptic'), ('haptic', 6, 'haptic'), ('haptic', 5, 'hapti'), ('haptic', 0, ''),
    ('no \x1b[2J of\tcan0\n', 80, 'no ?[2J of?can0?'), ('Prüfstand', 5, 'Prüfs'),
    ('Pru\u0308fstand', 5, 'Pru\u0308fs'), ('架台1', 4, '架台'), ('架台1', 3, '架')])
def test_a_line_is_fitted(text, width, expected):
    assert fitted(text, width) == expected


@pytest.mark.parametrize('coloured', [True, False])
@pytest.mark.parametrize('width', [0, 5, 20, 65, 66, 80, 200])
def test_a_row_fits_any_width(width, coloured):
    row = Row('singularity', 'near a parallel singularity', Colour.AMBER, 0.75)
    line = row.line(width, coloured)
    assert coloured or '\x1b' not in line
    bare = line.replace(Colour.AMBER.value, '').replace(PLAIN, '')
    assert '\x1b' not in bare
    assert len(bare) <= width
    # What is coloured ends plain.
    assert line.count(Colour.AMBER.value) == line.count(PLAIN) <= 1
    if width >= 80:
        assert re.search(r'at \[(#+)(-+)\] far near a parallel singularity', bare)
    if width == 200:
        assert 'at [##################------] far near a parallel singularity' in bare
    if width >= 66:
        assert bare.startswith('  singularity       ')
    elif width >= 42:
        assert bare.endswith('near a parallel singularity')
        assert bare.startswith('  singularity ')


LONG = ('silent: joint_1a, joint_1b, joint_1c, joint_3a: no answer, is the bus powered, and are '
        'the node ids those of the file?')


@pytest.mark.parametrize('coloured', [True, False])
@pytest.mark.parametrize('width', [66, 80, 100])
def test_a_reason_is_there_in_full_on_a_usual_terminal(width, coloured):
    rows = ['title', Row('state', LONG, Colour.RED), *(
        Row('caution', f'encoders: {LONG}', Colour.AMBER) for _ in range(2)),
        *(Row('rates', 'joints 0 Hz') for _ in range(7))]
    found = status_lines(rows, width, 23, coloured)
    bare = [re.sub(r'\x1b\[\d*m', '', line) for line in found]
    assert len(found) <= 23 and max(map(len, bare)) <= width
    assert bare[-1] == '  rates             joints 0 Hz'
    words = ' '.join(' '.join(bare).split())
    assert words.count(LONG) == 3
    # A row that goes on has no name, and the colour of that above.
    assert bare[2].startswith(' ' * 20) and bare[2][20] != ' '
    assert all(line.endswith(PLAIN) for line in found[1:3]) == coloured
    assert (Colour.RED.value in found[2]) == coloured


@pytest.mark.parametrize('height', [23, 11, 5, 2, 0])
def test_a_low_terminal_has_the_names_of_all_before_the_rest_of_one(height):
    rows = [Row('state', LONG), Row('caution', LONG), *(
        Row('rates', 'joints 0 Hz') for _ in range(8))]
    found = status_lines(rows, 80, height, False)
    assert len(found) <= height
    assert sum(line.startswith('  rates') for line in found) == max(0, min(8, height - 2))
    assert all(len(line) <= 80 for line in found)
    # On a narrow one a line is cut.
    assert status_lines(rows, 40, 23, False) == [row.line(40, False) for row in rows]


@pytest.mark.parametrize(('share', 'columns', 'expected'), [
    (0.5, 19, 'at [#####-----] far '), (0.0, 13, 'at [----] far '), (1.0, 13, 'at [####] far '),
    (7.0, 13, 'at [####] far '), (-1.0, 13, 'at [----] far '), (0.5, 12, ''), (0.5, -9, ''),
    (0.5, 500, f'at [{"#" * 12}{"-" * 12}] far ')])
def test_a_bar_is_as_long_as_there_is_place(share, columns, expected):
    assert bar(share, columns) == expected


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


def rows_of(width, **given):
    """Return the lines of a status below the title."""
    return [row.line(width, False) for row in console(**given)._rows(width)
            if isinstance(row, Row)]


def test_all_rows_of_a_status_with_force_feedback_and_cautions():
    """Four sensors and the dexterity of three; the bar is that of the page of `view`."""
    assert rows_of(80, encoders='joint_1b: EMCY 0x5000', caution='joint_3a unchecked',
                   force=FORCE_STATES['holding'], pose=(130.0, 50.0, 30.0)) == [
        '  state             healthy',
        '  caution           joint_3a unchecked',
        '  caution           encoders: joint_1b: EMCY 0x5000',
        '  force             holding',
        '  orientation       psi  130.000 theta  50.000 phi   30.000 deg',
        '  protection level  0.57 deg',
        '  parity            +0.1 sigma',
        '  singularity       at [##################------] far clear of singularities',
        '  dexterity         0.1500 (3 sensors), 0.4000 (4 sensors)',
        '  rates             joints 1000 Hz, orientation 1000 Hz',
        '  latency           p50 90 us, p99 200 us']


@pytest.mark.parametrize('state', ['starting', 'silent: no joint samples'])
def test_without_an_orientation_the_state_and_what_the_driver_knows_have_rows(state):
    assert rows_of(80, state=state, encoders='no frames on socketcan can0', dexterity=None) == [
        f'  state             {state}',
        '  caution           encoders: no frames on socketcan can0',
        '  singularity       unknown: clear of singularities',
        '  rates             joints 1000 Hz, orientation 1000 Hz',
        '  latency           p50 90 us, p99 200 us']


@pytest.mark.parametrize(('given', 'expected'), [
    ({'state': 'degraded: joint_3b missing', 'encoders': '', 'caution': 'joint_3a unchecked',
      'force': FORCE_STATES['holding']},
     'psi    0.000 theta   0.000 phi    0.000 deg, protection level 0.57 deg, '
     'degraded: joint_3b missing, joint_3a unchecked, force holding, dexterity 0.1500 (3 sensors) '
     '0.4000 (4 sensors) OK clear of singularities, '),
    # The reason of fkm comes before the caution of the driver.
    ({'state': 'silent: joint_1a jumped', 'encoders': 'joint_1b: EMCY 0x5000', 'dexterity': None,
      'caution': 'joint_3a unchecked'},
     'no orientation: silent: joint_1a jumped, encoders: joint_1b: EMCY 0x5000, '
     'dexterity unknown: clear of singularities, ')])
def test_a_line_for_a_log_has_all_in_it(given, expected):
    assert console(**given)._line() == (
        f'source can, {expected}joints 1000 Hz orientation 1000 Hz, '
        'latency p50 90 us p99 200 us\n')


def test_the_bar_is_empty_at_the_singularity_as_on_the_page():
    bars = [re.search(r'at \[(#*)-*\] far clear', line)[1] for eta in (0.0, 0.1, 0.2)
            for line in rows_of(80, dexterity=eta) if 'singularity ' in line]
    assert bars[0] == '' and 0 < len(bars[1]) < len(bars[2])


def test_the_largest_angles_fit_into_40_columns():
    (line,) = [line for line in rows_of(40, pose=(-179.96, 128.43, -134.56)) if 'psi' in line]
    assert line == '  psi -180.0 theta 128.4 phi -134.6 deg'
