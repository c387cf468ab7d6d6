# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nobody but `orientation_state` compares the words of a state or takes them apart."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ('spm_haptic_master', 'paper', 'study', 'benchmarks', 'docs')
# Where the words are read; and where one of them is the name of a parameter.
READERS = (ROOT / 'spm_haptic_master' / 'supervision' / 'orientation_state.py',
           ROOT / 'spm_haptic_master' / 'parameters' / 'limits.py')
CONDITIONS = ('starting', 'healthy', 'degraded', 'silent')
# Methods of texts that compare them or take them apart.
METHODS = {'startswith', 'endswith', 'removeprefix', 'removesuffix', 'partition', 'rpartition',
           'split', 'rsplit', 'find', 'index', 'count', 'replace', 'match', 'fullmatch', 'search',
           'get', 'pop', 'setdefault'}


def names_a_state(nodes: list[ast.AST], constants: dict[str, ast.AST]) -> bool:
    """Return whether expressions have words of a state, also by the name of a constant."""
    expressions = [*nodes, *(constants[each.id] for node in nodes for each in ast.walk(node)
                             if isinstance(each, ast.Name) and each.id in constants)]
    return any(isinstance(each, ast.Constant) and isinstance(each.value, str)
               and each.value.startswith(CONDITIONS)
               for node in expressions for each in ast.walk(node))


def comparisons(source: str) -> list[int]:
    """Return the lines that compare the words of a state or take them apart."""
    tree = ast.parse(source)
    constants: dict[str, ast.AST] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            constants |= {each.id: node.value for target in node.targets
                          for each in ast.walk(target) if isinstance(each, ast.Name)}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            parts: list[ast.AST] = [node.left, *node.comparators]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) \
                and node.func.attr in METHODS:
            # With the dictionary or pattern whose method it is.
            parts = [node.func.value, *node.args]
        elif isinstance(node, ast.Subscript):
            parts = [node.slice]
        elif isinstance(node, ast.MatchValue):
            parts = [node.value]
        elif isinstance(node, ast.Dict):
            parts = [key for key in node.keys if isinstance(key, ast.Constant)]
        else:
            continue
        if names_a_state(parts, constants):
            found.append(node.lineno)
    return sorted(set(found))


def test_the_words_of_a_state_are_read_in_one_place():
    violations = [
        f'{path.relative_to(ROOT)}:{line}' for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob('*.py'))
        if path not in READERS
        for line in comparisons(path.read_text())]
    assert not violations, '\n'.join(violations)


@pytest.mark.parametrize('source', [
    "x == 'healthy'", "x.startswith(('healthy', 'degraded'))", "x in ('starting', '')",
    "'silent' in x", "x == f'silent: {y}'", "COLOURS = {'healthy': 1}", "x['silent: a']",
    "USABLE = ('healthy',)\nx.startswith(USABLE)", "A, B = 'silent', 1\nx.startswith(A)",
    "re.match('degraded: (.*)', x)", "match x:\n    case 'healthy':\n        pass"])
def test_words_that_are_read_elsewhere_are_found(source):
    assert comparisons(source)
    assert not comparisons("level, text = WARN, 'starting: no orientation yet'\n"
                           "print('healthy sensors')\nf(state == HEALTHY)")
