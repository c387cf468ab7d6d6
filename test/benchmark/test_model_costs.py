# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The figure of `make bench` is the median of the processes, and their span is beside it."""

from benchmarks.kinematics import comparison_lines, Cost, over, table_lines
from benchmarks.model_costs import BUILT, CASE_2, FOUR, MULTI_BODY, NEWTON, SIX, SUPERVISED


def costs(**changed):
    """Return the costs of one process: 100 units each, but for the changed ones."""
    names = [CASE_2, FOUR, SIX, FOUR + BUILT, *SUPERVISED.values(), NEWTON, MULTI_BODY]
    units = dict.fromkeys(names, 100.0) | changed
    return {name: Cost(1e-6, cost, 1200 if name == FOUR else None) for name, cost in units.items()}


def row(lines, name):
    """Return the words of the row of an entry behind its name."""
    (line,) = [line for line in lines if line.startswith(name + '  ')]
    return line.removeprefix(name).split()


def test_one_process_in_a_bad_place_does_not_change_the_verdict():
    runs = [costs(**{FOUR: cost}) for cost in (1100.0, 1900.0, 1150.0)]
    assert row(table_lines(runs), FOUR) == '1.000 1150.0 1100.0 .. 1900.0 1200 met'.split()


def test_a_cost_above_its_reach_in_most_processes_is_not_met():
    runs = [costs(**{FOUR: cost}) for cost in (1100.0, 1900.0, 1201.0)]
    assert row(table_lines(runs), FOUR)[-2:] == ['not', 'met']


def test_entries_are_compared_process_by_process():
    slow = costs(**{SIX: 300.0, FOUR: 200.0})
    fast = costs(**{SIX: 150.0, FOUR: 100.0})
    assert over([slow, fast, fast], SIX, FOUR) == 1.5


def test_the_closed_form_has_to_be_faster_than_newton_raphson():
    met = '\n'.join(comparison_lines([costs(**{NEWTON: 2100.0})]))
    missed = '\n'.join(comparison_lines([costs(**{NEWTON: 1900.0})]))
    assert 'Case 2 is 21 times faster than the Newton-Raphson with numpy, reach 20: met' in met
    assert 'reach 20: not met' in missed
