# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package's configuration files, and an engineer's own: ROS parameter files, without ROS."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path
import sys

import yaml

from spm_haptic_master.exceptions import InputError

PACKAGE = 'spm_haptic_master'
NODE = 'encoder_driver'
# Which nodes a section of a parameter file speaks to, where it speaks to the driver.
SECTIONS = ('/**', f'/**/{NODE}', f'/{NODE}', NODE)


def config_directory() -> Path:
    """Return where the package's YAML files stand: a checkout, an ament share or a prefix."""
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)),
                sys.prefix]
    candidates = [Path(__file__).resolve().parents[1] / 'config',
                  *(Path(prefix) / 'share' / PACKAGE / 'config' for prefix in prefixes)]
    for candidate in candidates:
        if (candidate / 'sim.yaml').is_file():
            return candidate
    raise FileNotFoundError(f'{PACKAGE}: no config/sim.yaml in '
                            + ', '.join(str(candidate) for candidate in candidates))


def source_defaults(source: str) -> dict[str, object]:
    """Return what config/SOURCE.yaml says for the encoder driver, by parameter name."""
    return read_parameters(config_directory() / f'{source}.yaml')


def read_parameters(path: str | Path) -> dict[str, object]:
    """
    Return what a ROS parameter file says for the encoder driver, by dotted parameter name.

    Raises
    ------
    InputError
        The file cannot be read, or is no parameter file.

    """
    try:
        with open(path, encoding='utf-8') as file:
            content = yaml.safe_load(file)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error
    if not isinstance(content, Mapping):
        raise InputError(f'{path}: not a ROS parameter file (NODE: ros__parameters: ...)')
    found: dict[str, object] = {}
    # The more particular section says the last word.
    for name in SECTIONS:
        section = content.get(name)
        if section is None:
            continue
        if not isinstance(section, Mapping) \
                or not isinstance(section.get('ros__parameters'), Mapping):
            raise InputError(f'{path}: section {name} has no ros__parameters')
        found |= _flat(section['ros__parameters'])
    return found


def _flat(tree: Mapping, prefix: str = '') -> dict[str, object]:
    flat = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f'{prefix}{name}.')
        else:
            flat[f'{prefix}{name}'] = value
    return flat
