# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS parameter files read without ROS: the package's configuration, and a rig's own."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path
import sys

from spm_haptic_master.exceptions import InputError
import yaml

PACKAGE = 'spm_haptic_master'
# Node whose parameters are read.
NODE = 'encoder_driver'
# Source that describes the encoders; the other sources replay or simulate them.
ENCODERS_SOURCE = 'can'
# Sections of a parameter file that apply to the node, a more specific one later.
SECTIONS = ('/**', f'/**/{NODE}', f'/{NODE}', NODE)


def config_directory() -> Path:
    """Return the directory of the package's YAML files: of a checkout or an installation."""
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
    """
    Return the encoder driver's defaults for a source, by parameter name.

    They are those of config/SOURCE.yaml, and for the encoders those of config/can.yaml.
    """
    defaults: dict[str, object] = {}
    for name in dict.fromkeys((ENCODERS_SOURCE, source)):
        defaults |= read_parameters(config_directory() / f'{name}.yaml')
    return defaults


def simulated_rig() -> dict[str, object]:
    """Return the zero counts and directions of simulated encoders, by parameter name."""
    return read_parameters(config_directory() / 'simulated_rig.yaml')


def read_parameters(path: str | Path) -> dict[str, object]:
    """
    Return the encoder driver's parameters in a ROS parameter file, by dotted name.

    Raises
    ------
    InputError
        If the file cannot be read, or is not a parameter file.

    """
    try:
        with open(path, encoding='utf-8') as file:
            content = yaml.safe_load(file)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error
    if not isinstance(content, Mapping):
        raise InputError(f'{path}: not a ROS parameter file (NODE: ros__parameters: ...)')
    found: dict[str, object] = {}
    # A later, more specific section overrides an earlier one.
    for name in SECTIONS:
        section = content.get(name)
        if section is None:
            continue
        if not isinstance(section, Mapping) \
                or not isinstance(section.get('ros__parameters'), Mapping):
            raise InputError(f'{path}: section {name} has no ros__parameters')
        found |= _flat(section['ros__parameters'])
    return found


def _flat(tree: Mapping[str, object], prefix: str = '') -> dict[str, object]:
    """Return nested mappings as one, with dotted names."""
    flat: dict[str, object] = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f'{prefix}{name}.')
        else:
            flat[f'{prefix}{name}'] = value
    return flat
