# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measurements in a short form, on a machine that may be too busy for them."""

from benchmarks.pipeline import run
from disturbance import Disturbance
import pytest

# What a measurement prints where the machine is too busy for the pipeline.
OVERLOADED = ('overloaded', 'no orientation within', 'did not end within')


@pytest.fixture
def measured(monkeypatch, capsys):
    """Return what a measurement prints; skip the test where the machine was too busy for it."""
    monkeypatch.setattr(run, 'SETTLE', 0.3)

    def measured(main, *args):
        with Disturbance() as machine:
            code = main(['program', *args])
        out, err = capsys.readouterr()
        machine.expect(not any(words in err for words in OVERLOADED), err)
        assert (code, err) == (0, '')
        return out

    return measured
