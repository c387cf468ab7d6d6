# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texts of results against recorded ones: the same words, and numbers but for their rounding."""

from difflib import SequenceMatcher
from itertools import zip_longest
from math import isclose
import re

from harness import DATA

NUMBER = re.compile(r'[-+]?\d+\.?\d*(?:e[-+]\d+)?')
# Differences of two numbers that are rounding: of their size, and absolute.
RELATIVE = 1e-4
ABSOLUTE = 2e-4
# Lines that differ which a failure shows.
SHOWN = 20


def assert_recorded(name, text):
    """Compare a text with the recorded one in test/data; without one record it, and fail."""
    path = DATA / name
    if not path.exists():
        path.write_text(text, encoding='utf-8')
        raise AssertionError(f'test/data/{name} did not exist and is written: read it, test again')
    found = differences(text, path.read_text(encoding='utf-8'))
    accept = f'to accept what was found, delete test/data/{name} and run the test twice'
    assert not found, '\n'.join([f'{name}: {len(found)} lines differ', *found[:SHOWN], accept])


def differences(text, recorded):
    """Return a line for each that differs: its number, what was found, what was expected."""
    found = text.splitlines()
    expected = recorded.splitlines()
    blocks = SequenceMatcher(
        None, [*map(words, found)], [*map(words, expected)], autojunk=False
    ).get_opcodes()
    reported = []
    for _, begin, end, first, last in blocks:
        for got, wanted, number in zip_longest(
            found[begin:end], expected[first:last], range(first + 1, last + 1)
        ):
            if got is None or wanted is None or not is_same(got, wanted):
                reported.append(f'line {number or last}: found {got!r}, expected {wanted!r}')
    return reported


def words(line):
    """Return a line with its numbers and spaces made equal."""
    return NUMBER.sub('#', ' '.join(line.split()))


def is_same(line, expected):
    """Return whether two lines have the same words, and numbers within rounding."""
    numbers = NUMBER.findall(line)
    known = NUMBER.findall(expected)
    return words(line) == words(expected) and all(
        isclose(
            float(number),
            float(other),
            rel_tol=RELATIVE,
            abs_tol=ABSOLUTE,
        )
        for number, other in zip(numbers, known, strict=True)
    )
