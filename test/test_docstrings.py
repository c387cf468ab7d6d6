# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Docstrings of what other programs import: each argument, the result, in numpydoc's sections."""

from importlib import import_module
import inspect
import re

import pytest
from spm_haptic_master import exceptions

ROOMS = ('kinematics', 'supervision', 'force')


def public():
    """Return the public functions and classes, by their full name."""
    found = {}
    for room in ROOMS:
        module = import_module(f'spm_haptic_master.{room}')
        for name in module.__all__:
            value = getattr(module, name)
            if callable(value):
                found[f'{room}.{name}'] = value
    for name, value in vars(exceptions).items():
        if isinstance(value, type) and issubclass(value, exceptions.SpmError):
            found[f'exceptions.{name}'] = value
    return found


PUBLIC = public()


def documented(value, title):
    """Return the names in a section of a docstring; None where it has no such section."""
    found = re.search(
        rf'^{title}\n-+\n(.*?)(?=^\S[^\n]*\n-+\n|\Z)',
        inspect.getdoc(value) or '',
        re.MULTILINE | re.DOTALL,
    )
    if found is None:
        return None
    lines = re.findall(r'^(\*{0,2}\w[\w*, ]*?)(?: :.*)?$', found[1], re.MULTILINE)
    return {name.strip('* ') for line in lines for name in line.split(',')}


@pytest.mark.parametrize('name', PUBLIC)
def test_every_public_name_says_what_it_is(name):
    assert inspect.getdoc(PUBLIC[name])


FUNCTIONS = [name for name, value in PUBLIC.items() if inspect.isfunction(value)]


@pytest.mark.parametrize('name', FUNCTIONS)
def test_every_argument_of_a_public_function_is_described(name):
    given = inspect.signature(PUBLIC[name]).parameters
    assert set(given) - (documented(PUBLIC[name], 'Parameters') or set()) == set()


@pytest.mark.parametrize('name', FUNCTIONS)
def test_every_result_of_a_public_function_is_described(name):
    if inspect.signature(PUBLIC[name]).return_annotation not in (None, 'None'):
        assert documented(PUBLIC[name], 'Returns') is not None
