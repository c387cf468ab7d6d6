# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writes the mechanism as URDF with meshes, nominal or as built."""

from __future__ import annotations

from pathlib import Path

from spm_haptic_master.description.urdf import write
from spm_haptic_master.parameters.arguments import Parser
from spm_haptic_master.parameters.geometry import geometry_from, GEOMETRY_SETTINGS
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Writes DIR/spm.urdf and DIR/meshes/*.stl: the mechanism of the parameters geometry.*, without them
the nominal one. Give it the files that `fkm` has: the URDF is then that of the rig."""


@command_line.program('urdf')
def main(args: list[str]) -> int:
    """
    Write the mechanism of the parameters `geometry.*` as URDF with meshes to -o DIR.

    --prefix is what the URDF names the directory by; without it that is its absolute path.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0. After an error, which is one line on stderr, it is 1.

    """
    parser = Parser('urdf', DESCRIPTION)
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('urdf'),
        metavar='DIR',
        help='directory (default: urdf)',
    )
    parser.add_argument(
        '--prefix',
        metavar='TEXT',
        help='what the URDF names DIR by, such as '
        'package://PACKAGE/urdf (default: file:// and its absolute path)',
    )
    options = parser.parse(args)
    values = command_line.checked(
        command_line.given(options, names={setting.name for setting in GEOMETRY_SETTINGS}),
        GEOMETRY_SETTINGS,
    )
    output = options.output
    if options.prefix is None:
        prefix = output.absolute().as_uri()
    else:
        prefix = options.prefix
    print(write(geometry_from(values), output, prefix))
    return 0
