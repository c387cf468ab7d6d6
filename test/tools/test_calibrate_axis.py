# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate --insertion` and `--gripper`: from a log and from a bus of another stack."""

import io
from math import radians
import time

from encoder_frames import cycle, decoder, PERIOD, record, T0
from foreign_nodes import foreign_bus, objects_of
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.parameters.files import read_sections
from spm_haptic_master.tools import calibrate_axis, command_line
from spm_haptic_master.tools.calibrate import main

# The slide as it is built: counts at insertion 0, direction, counts per metre, ends (m).
ZERO = 40
DIRECTION = -1
PER_METRE = 2e5
ENDS = (0.0, 0.25)
SLIDE = ('-p', 'insertion.id:=0x185')
GRIPPER = ('-p', 'gripper.id:=0x186', '-p', 'gripper.counts_per_turn:=4096')


def way(
    first,
    second,
    begin=0.5,
    length=1.0,
    end=0.5,
):
    """Return positions each ms: at rest, in motion, at rest."""
    return np.concatenate(
        [
            np.full(round(begin / PERIOD), first),
            np.linspace(first, second, round(length / PERIOD)),
            np.full(round(end / PERIOD), second),
        ]
    )


def log(
    path,
    counts,
    identifier=0x185,
    without=(),
):
    """Write a log of the four encoders at rest, and of an axis with counts each cycle."""
    frames = []
    for number, count in enumerate(counts):
        frames += cycle(number)
        if number not in without:
            data = (round(count) % (1 << 32)).to_bytes(4, 'little')
            frames.append(canopen.frame(identifier, data, T0 + PERIOD * number + 9e-4))
    return record(path, frames)


def slide_log(
    path,
    first=ENDS[0],
    second=ENDS[1],
    zero=ZERO,
    direction=DIRECTION,
    **how,
):
    """Write the log of a slide between two insertions, m."""
    return log(path, zero + direction * PER_METRE * way(first, second), **how)


def run(capsys, path, *args):
    """Return exit code, stdout and the last line of stderr."""
    replay = ('-p', 'source:=replay', '-p', f'replay.path:={path}')
    code = main(['calibrate', *replay, *map(str, args)])
    out, err = capsys.readouterr()
    return code, out, ['', *err.splitlines()][-1]


def parameters(path):
    """Return the parameters of all nodes in a file."""
    return {section.nodes: section.values for section in read_sections(path)}['/**']


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize('ends', [ENDS, ENDS[::-1]])
def test_a_slide_is_read_as_it_is_after_its_calibration(
    capsys,
    tmp_path,
    direction,
    ends,
):
    """The counts pass through 0, and its ends may be in either order."""
    path = tmp_path / 'a.log'
    output = tmp_path / 'c.yaml'
    slide_log(path, *ends, direction=direction)
    code, out, err = run(capsys, path, *SLIDE, '--insertion', *ends, '-o', output)
    assert (code, err) == (0, '')
    found = parameters(output)
    assert found['insertion.direction'] == direction
    assert found['insertion.counts_per_metre'] == pytest.approx(PER_METRE, rel=1e-4)
    assert found['insertion.range'] == pytest.approx(sorted(ENDS))
    taker = decoder(**{name.replace('.', '__'): value for name, value in found.items()})
    for number, insertion in enumerate((0.0, 0.1, 0.25)):
        counts = round(ZERO + direction * PER_METRE * insertion) % (1 << 32)
        at = T0 + number
        taker.feed(canopen.frame(0x185, counts.to_bytes(4, 'little'), at))
        assert taker.readings.pop().position == pytest.approx(insertion, abs=1e-4)


def test_a_gripper_is_read_from_its_closed_end(capsys, tmp_path):
    path = tmp_path / 'a.log'
    output = tmp_path / 'c.yaml'
    per_deg = 4096 / 360.0
    # It opens by 61 deg, which its user takes for 60.
    log(path, 700 - per_deg * way(61.0, 0.0), identifier=0x186)
    code, _, err = run(capsys, path, *GRIPPER, '--gripper', 60, 0, '-o', output)
    assert (code, err) == (0, '')
    found = parameters(output)
    assert (found['gripper.direction'], found['gripper.zero_count']) == (-1, 700)
    assert found['gripper.range_deg'] == pytest.approx((0.0, 61.0), abs=0.1)
    taker = decoder(**{name.replace('.', '__'): value for name, value in found.items()})
    taker.feed(canopen.frame(0x186, (700 - round(per_deg * 61)).to_bytes(4, 'little'), T0))
    assert taker.readings.pop().position == pytest.approx(radians(61.0), abs=2e-3)
    # Half the counts per turn is no error of an angle.
    code, _, err = run(
        capsys,
        path,
        *GRIPPER[:2],
        '-p',
        'gripper.counts_per_turn:=8192',
        '--gripper',
        60,
        0,
        '-o',
        output,
        '--force',
    )
    assert code == 1
    assert 'gripper turned by 30.5 deg with gripper.counts_per_turn 8192' in err


EXISTING = """\
# Calibration of the left arm.
/**:
  ros__parameters:
    calibration: "jig, 2026-01-01"
    sigma_deg: [0.04, 0.04, 0.04, 0.05]
    encoders:
      zero_count: [1, 2, 3, 4]
      direction_verified: [true, true, true, false]
    can.channel: "1e5"
/left/fkm:
  ros__parameters:
    alert_limit_deg: 1.5
calibration_record:
  ros__parameters:
    method: "jig"
"""


def sections_of(path):
    """Return the values in a parameter file, by the nodes of their sections."""
    return {section.nodes: section.values for section in read_sections(path)}


@pytest.fixture
def added(tmp_path, capsys):
    """Add a slide to an existing calibration; return what does so again, and the file."""
    path = slide_log(tmp_path / 'a.log')
    output = tmp_path / 'c.yaml'
    output.write_text(EXISTING)

    def add(*args):
        return run(capsys, path, *SLIDE, '--insertion', *ENDS, '-o', output, *args)

    code, _, err = add()
    assert code == 0, err
    return add, output


def test_an_existing_calibration_keeps_all_that_it_has(added, tmp_path):
    _, output = added
    existing = tmp_path / 'existing.yaml'
    existing.write_text(EXISTING)
    before = sections_of(existing)
    after = sections_of(output)
    written = output.read_text()
    assert written.startswith('# Calibration of the left arm.\n# insertion calibrated on ')
    assert after.keys() == before.keys()
    for nodes, values in before.items():
        assert values.items() <= after[nodes].items()
    assert {name for name in after['/**'] if name not in before['/**']} == {
        'insertion.id',
        'insertion.direction',
        'insertion.zero_count',
        'insertion.counts_per_metre',
        'insertion.range',
    }


def test_a_slide_is_added_a_second_time_only_with_force(added):
    """Then with one line of comment as before."""
    add, output = added
    written = output.read_text()
    code, _, err = add()
    assert code == 1
    assert 'already has insertion.zero_count; expected --force' in err
    assert output.read_text() == written
    code, _, err = add('--force')
    assert code == 0, err
    assert output.read_text().count('# insertion calibrated on ') == 1


@pytest.mark.parametrize(
    ('changed', 'words'),
    [
        ({}, None),
        ({'zero': ZERO + 2000}, 'its first end reads -0.01 m, not 0; its second end reads 0.24'),
        ({'direction': 1}, 'insertion counts in the opposite direction'),
        ({'second': 0.2}, 'its second end reads 0.2 m, not 0.25'),
    ],
)
def test_a_check_says_what_changed(
    capsys,
    tmp_path,
    changed,
    words,
):
    output = tmp_path / 'c.yaml'
    before = slide_log(tmp_path / 'a.log')
    assert run(capsys, before, *SLIDE, '--insertion', *ENDS, '-o', output)[0] == 0
    written = output.read_text()
    now = slide_log(tmp_path / 'b.log', **changed)
    code, out, err = run(capsys, now, *SLIDE, '--insertion', *ENDS, '--check', output)
    assert (code, err) == (0 if words is None else 1, '')
    assert (words or 'the calibration of the slide holds') in out
    assert output.read_text() == written


@pytest.mark.parametrize(
    ('counts', 'without', 'words'),
    [
        (way(100, 120), (), 'insertion did not move: 20 counts'),
        (way(0, 50000), range(2000), 'insertion missing (no frames); expected its readings'),
        (way(0, 50000), range(900, 1500), 'insertion: no reading for 0.60 s, 0.9 s after'),
        (way(0, 50000, begin=0.01), (), 'counts at its first end; expected 0.3 s at rest'),
        (way(0, 50000, end=0.01), (), 'counts at its second end; expected 0.3 s at rest'),
        (way(0, 50000)[:100], (), '100 readings; expected at least 5 in 0.3 s at rest'),
        (way(0, 50000) % 40000, (), 'insertion jumps by 39'),
        (np.concatenate([way(0, 9000), way(9000, 5000)]), (), 'went beyond where it rested'),
    ],
)
def test_what_is_no_motion_from_end_to_end_is_refused(
    capsys,
    tmp_path,
    counts,
    without,
    words,
):
    path = log(tmp_path / 'a.log', counts, without=without)
    output = tmp_path / 'c.yaml'
    code, _, err = run(capsys, path, *SLIDE, '--insertion', *ENDS, '-o', output)
    assert code == 1
    assert words in err
    assert not output.exists()


@pytest.mark.parametrize(
    ('args', 'words'),
    [
        (('--insertion', 0.1, 0.1, *SLIDE), '--insertion 0.1 0.1: both ends are equal'),
        (('--insertion', 0, 0.2), 'insertion.id is 0; expected the CAN identifier'),
        (('--insertion', 0, 0.2, '--gripper', 60, 0, *SLIDE), '--insertion and --gripper; exp'),
        (
            ('--insertion', 0, 0.2, *SLIDE, '--seconds', 3),
            '--seconds beside --insertion; expected',
        ),
        (('--insertion', 0, 0.2, *SLIDE, '--motion'), '--motion beside --insertion; expected one'),
        (('--insertion', 0, 9.0, *SLIDE), "parameter 'insertion.range'"),
        (('--insertion', 0, 0.2, *SLIDE, '-p', 'source:=sim'), 'a simulation has nothing to'),
    ],
)
def test_what_cannot_be_calibrated_is_refused(
    capsys,
    tmp_path,
    args,
    words,
):
    path = slide_log(tmp_path / 'a.log')
    output = tmp_path / 'c.yaml'
    code, _, err = run(capsys, path, *args, '-o', output)
    assert code == 1
    assert words in err
    assert not output.exists()


def test_a_check_needs_a_calibration_of_that_axis(capsys, tmp_path):
    path = slide_log(tmp_path / 'a.log')
    other = tmp_path / 'c.yaml'
    other.write_text('/**:\n  ros__parameters:\n    sigma_deg: [0.1, 0.1, 0.1, 0.1]\n')
    code, _, err = run(capsys, path, *SLIDE, '--insertion', *ENDS, '--check', other)
    assert code == 1
    assert 'no insertion.zero_count' in err


class Hand:
    """Standard input of a user who presses Enter, the second time with the slide moved."""

    def __init__(self, nodes):
        self._nodes = nodes
        self._lines = 0

    def readline(self):
        """Return a line a while later: the encoders are started, and rest at each end."""
        self._lines += 1
        positions = way(0.0, 0.25, begin=0.5, length=0.5, end=0.5)[::20]
        for insertion in positions if self._lines == 2 else positions[:1].repeat(40):
            self._nodes[4].counts = round(5000 + PER_METRE * insertion)
            time.sleep(0.02)
        return '\n'


NODES = (1, 2, 3, 4, 5)


@pytest.mark.parametrize('answers', [True, False])
def test_a_slide_on_a_bus_is_calibrated_from_enter_to_enter(
    channel,
    capsys,
    tmp_path,
    monkeypatch,
    answers,
):
    """Another stack's encoder, which is started, read at rest, moved, and read at rest."""
    monkeypatch.setattr(command_line, 'SIGNALS', ())
    output = tmp_path / 'c.yaml'
    bus = ('can.interface:=virtual', f'can.channel:={channel}', 'can.sync:=produce', 'rate:=50.0')
    slide = ('insertion.id:=0x185', 'insertion.node_id:=5', 'can.timeout:=0.5')
    with foreign_bus(channel, *((n, objects_of(n)) for n in NODES)) as nodes:
        if not answers:
            nodes[4].on_sync = lambda: None
        monkeypatch.setattr(calibrate_axis.sys, 'stdin', Hand(nodes))
        code = main(
            [
                'calibrate',
                *(part for text in (*bus, *slide) for part in ('-p', text)),
                *('--insertion', '0', '0.25', '-o', str(output)),
            ]
        )
    err = capsys.readouterr().err
    assert 'hold the slide at 0 m, then press Enter' in err
    if not answers:
        assert code == 1
        assert 'insertion missing (' in err
        assert not output.exists()
        return
    assert code == 0, err
    found = parameters(output)
    assert found['insertion.zero_count'] == pytest.approx(5000, abs=2)
    assert found['insertion.counts_per_metre'] == pytest.approx(PER_METRE, rel=1e-3)


def test_standard_input_that_has_ended_is_refused(
    channel,
    capsys,
    tmp_path,
    monkeypatch,
):
    monkeypatch.setattr(command_line, 'SIGNALS', ())
    monkeypatch.setattr(calibrate_axis.sys, 'stdin', io.StringIO())
    bus = ('-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}', *SLIDE)
    output = tmp_path / 'c.yaml'
    assert main(['calibrate', *bus, '--insertion', '0', '1', '-o', str(output)]) == 1
    assert 'standard input has ended; expected Enter at each end' in capsys.readouterr().err


def test_a_jig_calibration_keeps_the_slide(capsys, tmp_path):
    """The file of a jig is overwritten with --force: what it says of the slide stays."""
    path = slide_log(tmp_path / 'a.log')
    output = tmp_path / 'c.yaml'
    jig = ('--seconds', 0.3, '-p', 'replay.rate:=20.0', '-o', output)
    assert run(capsys, path, *jig)[0] == 0
    assert run(capsys, path, *SLIDE, '--insertion', *ENDS, '-o', output)[0] == 0
    slide = {name: value for name, value in parameters(output).items() if 'insertion' in name}
    code, _, err = run(capsys, path, *jig, '--force')
    assert (code, err) == (0, '')
    assert slide.items() <= parameters(output).items()
