# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measurement of `view` beside `master`, in a short form; no timings."""

import re

from benchmarks import browser_process, view_load
import pytest


@pytest.mark.process
@pytest.mark.alone
@pytest.mark.evidence
@pytest.mark.skipif(browser_process.browser() is None, reason='no Chromium is installed')
def test_view_prints_ratios_and_the_load_of_view(measured, monkeypatch):
    pytest.importorskip('viser', reason='viser is not installed (extra view)')
    monkeypatch.setattr(view_load, 'LOAD_TIME', 3.0)
    out = measured(view_load.main, '--seconds', '1.0', '--rounds', '1')
    assert 'realtime.priority 10, as make run' in out \
        or 'realtime.priority 0: SCHED_FIFO is not permitted' in out
    assert re.search(r'view with a browser: p50 \d+ .*, view [\d.]+ % of a core, '
                     r'[\d.]+ -> [\d.]+ MiB', out)
    for case in ('view without a browser', 'view with a browser'):
        for name in ('p50', 'p99'):
            assert re.search(rf'{name}, {case}, over alone: [\d.]+ \(', out)
        assert re.search(rf'CPU of view, {case}: [\d.]+ % of a core', out)
