# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program `view`: its page, whom it serves, and when it ends."""

import os
import subprocess
import sys
from urllib.error import URLError
from urllib.request import urlopen

from benchmarks import view_load
from benchmarks.pipeline.child_process import wait_until
from harness import ROOT, start_command
import pytest

PATIENCE = 120.0
FIRST_LINE = 'view: http://127.0.0.1:'


@pytest.mark.process
def test_it_serves_a_page_to_this_host_alone_and_ends(start):
    pytest.importorskip('viser', reason='viser is not installed (extra view)')
    program = start('view', parameters={'view.port': 18080})
    assert wait_until(lambda: '\n' in program.stdout, PATIENCE), program.stderr
    url = program.stdout.removeprefix('view: ').strip()
    with urlopen(url, timeout=PATIENCE) as page:
        assert b'<html' in page.read()
    # Another address of this host is refused: the page is bound to 127.0.0.1.
    with pytest.raises(URLError):
        urlopen(url.replace('127.0.0.1', '127.0.0.2'), timeout=PATIENCE)
    assert program.stop() == 0
    assert (program.stdout, program.stderr) == (f'view: {url}\n', '')


@pytest.mark.process
def test_without_viser_one_line_says_how_to_get_it(start_python):
    program = start_python(
        '-c',
        (
            'import sys; sys.modules["viser"] = None\n'
            'from spm_haptic_master.__main__ import start\nsys.exit(start("view", ["view"]))'
        ),
    )
    assert program.wait(PATIENCE) == 1
    assert program.stderr == (
        'view: the Python module viser is missing: python3 -m venv --system-site-packages ~/view '
        "&& ~/view/bin/pip install 'viser<2' websockets msgspec; then ~/view/bin/python -m "
        'spm_haptic_master view\n'
    )


def make_run(view, python):
    """Return the command of `make run`, with an interpreter, after the installation."""
    printed = subprocess.run(
        ['make', '-n', '--no-print-directory', 'run', f'VIEW={view}'],
        cwd=ROOT,
        text=True,
        capture_output=True,
        check=True,
    ).stdout
    command = '\n'.join(printed.splitlines()[-2:]).replace('.venv/bin/python', python)
    return ['sh', '-c', command]


def test_make_run_leaves_it_out_on_request():
    started = subprocess.run(
        make_run(0, 'echo'),
        text=True,
        capture_output=True,
        check=True,
    )
    assert started.stdout.startswith('-m spm_haptic_master master --params-file ')


@pytest.mark.process
def test_make_run_starts_it_beside_master():
    """
    With less priority; it ends with master.

    The priority of master is a real-time one, where this user may have it.
    """
    pytest.importorskip('viser', reason='viser is not installed (extra view)')
    running = start_command(make_run(1, sys.executable))
    try:
        assert wait_until(
            lambda: 'psi' in running.stdout and FIRST_LINE in running.stdout, PATIENCE
        ), running.stderr
        listed = subprocess.run(
            ['ps', '-ww', '-eo', 'pid=,ni=,args='],
            text=True,
            check=True,
            capture_output=True,
        ).stdout.splitlines()
        ((pid, nice),) = [
            line.split()[:2]
            for line in listed
            if 'sh -c' not in line and line.endswith(f'view -p view.process:={running.pid}')
        ]
        assert int(nice) > os.getpriority(os.PRIO_PROCESS, running.pid)
        if view_load.may_have_priority(10):
            policy = os.SCHED_FIFO
        else:
            policy = os.SCHED_OTHER
        assert os.sched_getscheduler(running.pid) == policy
        assert os.sched_getscheduler(int(pid)) == os.SCHED_OTHER
        assert running.stop() == 0
        assert wait_until(lambda: not os.path.exists(f'/proc/{pid}'), PATIENCE)
    finally:
        running.kill()
