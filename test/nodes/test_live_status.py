# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live status on a terminal, as an emulator shows it, and its words."""

import re
from types import SimpleNamespace

from harness import SIM, SIMULATED
import numpy as np
import pytest
from spm_haptic_master.benchmark.child_process import executable, wait_until
from spm_haptic_master.force.force_state import read_force_state
from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes.console import Console, FAR
from spm_haptic_master.nodes.status_rows import bar, Colour, fitted, PLAIN, Row, status_lines
from spm_haptic_master.orientation_state import read_state
from spm_haptic_master.ros.diagnostic_status import OK
from spm_haptic_master.view.readout import FULL_DEXTERITY
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
# A line more where fkm has a caution: Fig. 9 begins where the others cannot check th3A.
# What does not fit into it is in lines below it.
CAUTION = re.compile(r'  caution           (joint_|noise ).*| {20}\S.*')


@pytest.fixture
def terminal():
    """Start an executable on a terminal of a size; it ends with the test."""
    made = []

    def start(columns, lines, *args, parameters=None, **changes):
        made.append(Terminal(executable(
            'master', *args, parameters={**SIM, **(parameters or {})}), columns, lines,
                             **changes))
        return made[-1]

    yield start
    for each in made:
        each.close()


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
    return {min(len(BLOCK) + caution, lines - 1) for caution in range(4)}


def has_orientation(screen):
    return any(' psi ' in line for line in screen.shown)


@pytest.mark.process
def test_the_status_fits_80_by_24_and_stays_in_its_place(terminal):
    screen = terminal(80, 24)
    assert screen.read_until(lambda: screen.raw.count(b'psi') > 6, PATIENCE)
    # A busy machine may withhold orientations meanwhile; the status then has another line.
    assert screen.read_until(
        lambda: is_whole(block_of(screen.text)), PATIENCE), screen.text
    # The cursor waits on an empty line above it.
    column, line = screen.cursor
    assert column == 0
    assert screen.shown[line] == ''
    assert screen.shown[line + 1] == TITLE
    assert screen.end(PATIENCE) == 0
    # The last status stays, and what comes next is printed below it.
    assert block_of(screen.text)[-1].startswith('  latency')
    assert screen.shown[screen.cursor[1] - 1].startswith('  latency')
    assert screen.cursor[0] == 0


@pytest.mark.process
@pytest.mark.parametrize(('columns', 'lines'), [
    (40, 12), (9, 3),
    *(pytest.param(*size, marks=pytest.mark.evidence) for size in ((200, 60), (80, 5)))])
def test_lines_are_cut_to_the_terminal(terminal, columns, lines):
    screen = terminal(columns, lines)
    assert screen.read_until(lambda: screen.raw.count(b'haptic') > 6, PATIENCE)
    if columns == 40:
        assert screen.read_until(lambda: has_orientation(screen), PATIENCE)
    screen.read(0.5)
    block = block_of(screen.text)
    assert block[0] == TITLE[:columns].rstrip()
    assert len(block) in heights(lines)
    if columns == 40:
        # All three angles, and their unit.
        assert any(re.fullmatch(r'  psi -?\d+\.\d theta -?\d+\.\d phi -?\d+\.\d deg', line)
                   for line in block), block
    # Each line of the screen is one of the status: none is wrapped.
    assert all(line.startswith('  ') for line in block[1:])
    assert screen.end(PATIENCE) == 0


@pytest.mark.process
def test_another_size_and_other_libraries_leave_no_ghosts(terminal):
    screen = terminal(80, 24)
    assert screen.read_until(lambda: has_orientation(screen), PATIENCE)
    for columns, lines in ((50, 20), (120, 30), (30, 8), (80, 24)):
        screen.print_to(f'a library prints at {columns}\n')
        screen.read(0.4)
        screen.resize(columns, lines)
        screen.read(0.7)
        assert len(block_of(screen.shown)) in heights(lines)
    printed = [line for line in screen.text if line.startswith('a library')]
    assert printed == [f'a library prints at {columns}' for columns in (50, 120, 30, 80)]
    assert screen.end(PATIENCE) == 0


@pytest.mark.process
@pytest.mark.parametrize('changes', [
    {}, pytest.param({'NO_COLOR': '1'}, marks=pytest.mark.evidence)], ids=['coloured', 'NO_COLOR'])
def test_the_log_is_intact_above_the_status(terminal, start, bus_channel, changes):
    bus = ('-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel}')
    screen = terminal(250, 24, *bus, *SIMULATED, parameters={'source': 'can'}, **changes)
    publishing = f'publishing [can: udp_multicast {bus_channel}]'
    assert screen.read_until(lambda: b'no frames' in screen.raw, PATIENCE)
    start('sim_bus', *bus, '--sync', *(option for number in range(2, 20) for option in (
        '--fault', f'dropout:joint_1a@{number}+0.4')))

    def logged():
        return [LOGGED.sub('', line) for line in screen.text if LOGGED.match(line)]

    assert screen.read_until(
        lambda: {'silent: no joint samples', 'healthy', publishing} <= set(logged()),
        PATIENCE), screen.text
    assert screen.end(PATIENCE) == 0
    # Above the status there is nothing but whole lines of the log.
    title = screen.text.index('haptic master, source can (Ctrl-C ends)')
    assert all(LOGGED.match(line) for line in screen.text[:title] if line)
    assert len([line for line in screen.text if line.startswith('haptic')]) == 1
    assert (b'\x1b[31m' in screen.raw) == (not changes)


@pytest.mark.process
def test_a_terminal_without_controls_gets_lines(terminal):
    screen = terminal(200, 24, TERM='dumb')
    assert screen.read_until(lambda: screen.raw.count(b'latency p50') >= 2, PATIENCE)
    assert b'\x1b' not in screen.raw
    assert screen.shown[0] == f'{TITLE}: the simulated motion crosses the singularity on purpose'
    assert screen.end(PATIENCE) == 0


@pytest.mark.process
def test_a_motion_clear_of_the_singularity_has_no_remark(start):
    master = start('master', parameters={**SIM, 'sim.trajectory': 'fixed', 'rate': 100.0})
    assert wait_until(lambda: 'psi' in master.stdout, PATIENCE)
    assert master.stdout.startswith(f'{TITLE}\nsource sim, ')


@pytest.mark.process
def test_the_reason_of_fkm_comes_before_the_caution_of_the_driver(start, bus_channel):
    bus = ('-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel}')
    master = start('master', '--ros-args', *bus, '-p', 'source:=can', '-p', 'rate:=200.0',
                   *SIMULATED)
    # The driver's caution is an emergency; fkm withholds what is inconsistent.
    start('sim_bus', *bus, '--sync', '-p', 'rate:=200.0', '--fault', 'emcy:joint_1b@1=0x5000',
          *(option for joint in ('joint_1a', 'joint_1c', 'joint_3a')
            for option in ('--fault', f'offset:{joint}@3=35')))
    assert wait_until(lambda: re.search(
        r'no orientation: silent: (?!no joint).*, encoders: joint_1b: EMCY 0x5000', master.stdout),
        PATIENCE), (master.stdout, master.stderr)


@pytest.mark.parametrize(('text', 'width', 'expected'), [
    ('haptic', 80, 'haptic'), ('haptic', 6, 'haptic'), ('haptic', 5, 'hapti'), ('haptic', 0, ''),
    ('no \x1b[2J of\tcan0\n', 80, 'no ?[2J of?can0?'), ('Prüfstand', 5, 'Prüfs'),
    ('Pru\u0308fstand', 5, 'Pru\u0308fs'), ('架台1', 4, '架台'), ('架台1', 3, '架')])
def test_a_line_is_fitted(text, width, expected):
    assert fitted(text, width) == expected


@pytest.mark.parametrize('coloured', [True, False])
@pytest.mark.parametrize('width', [0, 1, 5, 9, 20, 40, 65, 66, 80, 200])
def test_a_row_fits_any_width(width, coloured):
    row = Row('singularity', 'near a parallel singularity', Colour.AMBER, 0.75, ('at', 'far'))
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
    (0.5, 12, '[#####-----] '), (0.0, 6, '[----] '), (1.0, 6, '[####] '), (7.0, 6, '[####] '),
    (-1.0, 6, '[----] '), (0.5, 5, ''), (0.5, 0, ''), (0.5, -9, ''),
    (0.5, 500, f'[{"#" * 12}{"-" * 12}] ')])
def test_a_bar_is_as_long_as_there_is_place(share, columns, expected):
    assert bar(share, columns) == expected


def test_a_bar_says_what_its_ends_are():
    assert bar(0.0, 20, ('at', 'far')) == 'at [-----------] far '
    assert bar(1.0, 20, ('at', 'far')) == 'at [###########] far '
    assert bar(0.5, 12, ('at', 'far')) == ''


class Rows(Console):
    """The rows of a status without its thread."""

    def __init__(self, driver, fkm, diagnostics):
        self._driver, self._fkm, self._diagnostics = driver, fkm, diagnostics


def rows_of(width, state='healthy', encoders='publishing', dexterity=0.15, pose=(0.0, 0.0, 0.0),
            force=None):
    """Return the lines of a status by name."""
    meter = SimpleNamespace(rate=lambda: 1000.0, percentiles=lambda *_: (90.0, 200.0))
    quaternion = tuple(quaternion_from_matrix(matrix_from_zxz(*np.radians(pose))).tolist())
    fkm = SimpleNamespace(state=read_state(state), caution='', quaternion=quaternion,
                          protection_level=0.01, force_state=force,
                          latency_status=SimpleNamespace(parity=0.1, published=meter,
                                                         latency=meter))
    driver = SimpleNamespace(state=encoders, source_name='can', rate=1000.0)
    diagnostics = SimpleNamespace(
        state='clear of singularities', level=OK, sensors=4,
        dexterities=SimpleNamespace(three=dexterity, every=0.4))
    rows = Rows(driver, fkm, diagnostics)._rows(width)
    return [row.line(width, False) for row in rows if isinstance(row, Row)]


def test_force_feedback_has_a_row_where_it_is_on():
    assert not any(line.split()[0] == 'force' for line in rows_of(80))
    with_force = rows_of(80, force=read_force_state('holding'))
    assert [line.split() for line in with_force if 'force' in line] == [['force', 'holding']]


@pytest.mark.parametrize('state', ['starting', 'silent: no joint samples'])
def test_the_row_of_the_state_is_the_state(state):
    """Also where the driver knows why: that is a row of its own."""
    lines = rows_of(80, state, 'no frames on socketcan can0')
    assert lines[0] == f'  state             {state}'
    assert lines[1] == '  caution           encoders: no frames on socketcan can0'


def test_the_bar_is_empty_at_the_singularity_as_on_the_page():
    bars = [re.search(r'at \[(#*)-*\] far clear', line)[1] for eta in (0.0, 0.1, 0.2)
            for line in rows_of(80, dexterity=eta) if 'singularity ' in line]
    assert bars[0] == '' and 0 < len(bars[1]) < len(bars[2])
    assert FAR == FULL_DEXTERITY


def test_the_largest_angles_fit_into_40_columns():
    (line,) = [line for line in rows_of(40, pose=(-179.96, 128.43, -134.56)) if 'psi' in line]
    assert line == '  psi -180.0 theta 128.4 phi -134.6 deg'


@pytest.mark.process
def test_the_first_line_of_a_newcomer_is_not_about_what_is_not_installed(start):
    master = start('master', parameters={**SIM, 'sim.trajectory': 'fixed', 'rate': 100.0})
    assert wait_until(lambda: master.stdout.count('psi') > 2, PATIENCE)
    assert 'crtk_msgs' not in master.stdout + master.stderr


@pytest.mark.process
@pytest.mark.parametrize(('changes', 'coloured'), [({}, True), ({'NO_COLOR': '1'}, False)])
def test_the_state_is_green_only_where_colours_are_wanted(terminal, changes, coloured):
    screen = terminal(80, 24, **changes)
    assert screen.read_until(lambda: b'healthy' in screen.raw, PATIENCE)
    assert (b'\x1b[32mhealthy\x1b[0m' in screen.raw) == coloured
    assert coloured or not re.search(rb'\x1b\[[\d;]*m', screen.raw)
    assert screen.end(PATIENCE) == 0
