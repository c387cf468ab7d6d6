# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The list of mutants that change nothing observable."""

from benchmarks.mutants import equivalent


def test_each_equivalent_mutant_is_one_change_of_the_code(capsys):
    """A renamed variable leaves its entry behind: the mutant would count as one that survived."""
    assert len(equivalent()) > 300
    assert capsys.readouterr().err == '', 'correct these in benchmarks/equivalent_mutants.txt'
