# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The size of functions, counted more strictly than ruff does.

Boolean operators and comprehensions are decisions, too. A function that is not yet divided is
named here; the list only shrinks.
"""

import ast

from harness import ROOT

# Largest complexity, and most lines without the docstring.
COMPLEXITY = 10
LINES = 50
DECISIONS = (
    ast.If,
    ast.IfExp,
    ast.For,
    ast.While,
    ast.ExceptHandler,
    ast.Assert,
    ast.comprehension,
    ast.match_case,
)
DEFINITIONS = ast.FunctionDef | ast.AsyncFunctionDef


def inside(function):
    """Yield the nodes of a function without those of functions and classes in it."""
    todo = list(ast.iter_child_nodes(function))
    while todo:
        node = todo.pop()
        if not isinstance(node, DEFINITIONS | ast.ClassDef):
            yield node
            todo += ast.iter_child_nodes(node)


def complexity(function):
    """Return McCabe's number: one more than there are decisions."""
    number = 1
    for node in inside(function):
        number += isinstance(node, DECISIONS)
        if isinstance(node, ast.BoolOp):
            number += len(node.values) - 1
        if isinstance(node, ast.comprehension):
            number += len(node.ifs)
    return number


def lines(function):
    """Return the lines of a function without its docstring."""
    first = function.body[0]
    has_docstring = ast.get_docstring(function, clean=False) is not None
    docstring = first.end_lineno - first.lineno + 1 if has_docstring else 0
    return function.end_lineno - function.lineno + 1 - docstring


def larger(path):
    """Return what each function of a file has that is larger, in words."""
    return [
        f'{path}:{node.lineno}: {node.name} has complexity {complexity(node)}, {lines(node)} lines'
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, DEFINITIONS) and (complexity(node) > COMPLEXITY or lines(node) > LINES)
    ]


def test_a_function_fits_a_page_and_has_few_decisions():
    found = [text for path in (ROOT / 'spm_haptic_master').rglob('*.py') for text in larger(path)]
    assert not found, '\n'.join(
        [
            *found,
            f'divide it: at most {COMPLEXITY}, where each `and`, `or`, comprehension and the `if` '
            f'in it counts, and {LINES} lines without the docstring',
        ]
    )


def test_decisions_of_operators_and_comprehensions_count():
    function = ast.parse('def f(x):\n    return [a for a in x if a and a > 1 or a < -1]').body[0]
    assert complexity(function) == 5
