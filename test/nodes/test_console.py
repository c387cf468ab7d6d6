# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live status on a terminal, as an emulator shows it, and its words."""

import os
import re
import select
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_text import assert_recorded
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.nodes import master as console_module
from spm_haptic_master.nodes.master import AMBER, Console, PLAIN, RED, Row, status_lines
from spm_haptic_master.ros.diagnostic_status import OK
from spm_haptic_master.supervision.orientation_state import read_state

TITLE = 'haptic master, source can (Ctrl-C ends)'


def test_status_and_log_stay_in_their_places_whatever_the_size(monkeypatch):
    """Also where the window becomes smaller, and where other libraries print."""
    pyte = pytest.importorskip('pyte', reason='pyte is not installed (extra test)')
    screen = pyte.HistoryScreen(80, 24, history=10_000)
    stream, printed = pyte.Stream(screen), console()
    monkeypatch.setattr(
        os, 'get_terminal_size', lambda _: os.terminal_size((screen.columns, screen.lines))
    )

    def shown():
        return [line.rstrip() for line in screen.display]

    for number, (columns, lines) in enumerate(
        ((80, 24), (50, 20), (9, 3), (200, 60), (80, 5), (120, 24))
    ):
        stream.feed(f'a library prints {number}\r\n')
        # As in xterm, a lower window loses lines below the cursor, and those above it leave it.
        row = screen.cursor.y
        above = max(0, row + 1 - lines)
        screen.cursor_position(1, 1)
        screen.insert_lines(max(0, screen.lines - lines - above))
        screen.resize(lines, columns)
        screen.cursor_position(row - above + 1, 1)
        logged = [f'{each} logged' for each in (f'first {number}', f'next {number}', 'last')]
        for line in logged:
            closing = columns == 120 and line == logged[-1]
            stream.feed(printed._refreshed([line], closing))
            (begin,) = [at for at, line in enumerate(shown()) if line.startswith('haptic')]
            expected = status_lines([TITLE], printed._rows(), columns, lines - 1, False)
            assert shown()[begin : begin + len(expected)] == list(map(str.rstrip, expected))
            if not closing:
                # The cursor waits on an empty line above the status.
                assert (screen.cursor.x, screen.cursor.y, shown()[begin - 1]) == (0, begin - 1, '')
    # The last status remains, and what comes next is printed below it.
    assert shown()[screen.cursor.y - 1].startswith('  latency') and screen.cursor.x == 0
    above = [
        ''.join(line[column].data for column in range(screen.columns)).rstrip()
        for line in screen.history.top
    ] + shown()
    assert [line for line in above if 'logged' in line][-3:] == logged
    assert sum(line.startswith('haptic') for line in above) == 1


def test_a_terminal_without_a_size_has_80_columns_and_24_lines(monkeypatch):
    printed, found = console(caution='long ' * 500), []
    for size in (0, 0), (80, 24):
        monkeypatch.setattr(os, 'get_terminal_size', lambda _, size=size: os.terminal_size(size))
        found.append(printed._refreshed([], False))
    assert found[0] == found[1] and found[0].count('\n') == 23


@pytest.mark.parametrize('term', ['dumb', 'xterm'])
def test_a_terminal_without_controls_gets_lines(monkeypatch, term):
    reading, device = os.openpty()
    monkeypatch.setenv('TERM', term)
    monkeypatch.setattr(console_module, 'STANDARD_OUTPUT', device)
    attached = []
    monkeypatch.setattr(
        console_module.node_log, 'attach', lambda taker, **_: attached.append(taker)
    )
    parts = parts_of()
    found = Console(parts.driver, parts.fkm, parts.diagnostics)
    assert attached == [found] * (term == 'xterm')
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


def parts_of(
    state='healthy',
    encoders='publishing',
    dexterity=0.15,
    pose=(0.0, 0.0, 0.0),
    force=None,
    caution='',
):
    """Return driver, fkm and diagnostics, as far as a console reads them."""
    meter = SimpleNamespace(rate=lambda: 1000.0, percentiles=lambda *_: (90.0, 200.0))
    quaternion = tuple(quaternion_from_matrix(matrix_from_zxz(*np.radians(pose))).tolist())
    fkm = SimpleNamespace(
        state=read_state(state),
        quaternion=quaternion,
        status=SimpleNamespace(caution=caution),
        protection_level=0.01,
        force_state=force,
        latency_status=SimpleNamespace(parity=0.1, published=meter, latency=meter),
    )
    driver = SimpleNamespace(state=encoders, source_name='can', published=meter)
    diagnostics = SimpleNamespace(
        state='clear of singularities',
        levels=SimpleNamespace(level=OK),
        sensors=4,
        dexterities=None if dexterity is None else SimpleNamespace(three=dexterity, every=0.4),
    )
    return SimpleNamespace(driver=driver, fkm=fkm, diagnostics=diagnostics)


def console(**given):
    """Return a console without its thread."""
    found, parts = Console.__new__(Console), parts_of(**given)
    found._coloured = True
    found._driver, found._fkm, found._diagnostics = parts.driver, parts.fkm, parts.diagnostics
    return found


def test_the_status_of_each_state_is_as_recorded():
    """With colours, as on a terminal, and in a line, as in a log."""
    lines = []
    for given in (
        *(
            {'state': state, 'dexterity': dexterity, 'pose': (130.0, 50.0, 30.0)}
            for state in ('starting', 'healthy', 'degraded: joint_3b missing', 'silent: jumped')
            for dexterity in (None, 0.0, 0.1, 7.0)
        ),
        {'encoders': 'joint_1b: EMCY 0x5000', 'caution': 'joint_3a unchecked'},
        *({'force': state, 'encoders': ''} for state in FORCE_STATES.values()),
    ):
        shown = console(**given)
        lines += [*status_lines(shown._title(), shown._rows(), 80, 23, True), shown._line()]
    assert_recorded('sessions/console.txt', '\n'.join(lines).replace('\x1b', '~'))


@pytest.mark.parametrize('coloured', [True, False])
@pytest.mark.parametrize(
    ('width', 'height'), [(0, 23), (9, 2), (30, 0), (80, 2), (50, 23), (200, 23)]
)
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
        assert all(
            (line.count(RED), line.endswith(PLAIN)) == (coloured, coloured) for line in found[1:-1]
        )
