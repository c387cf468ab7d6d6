# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generate what follows from the code, and print which files changed: python -m docs."""

from __future__ import annotations

from collections.abc import Mapping
import hashlib
from pathlib import Path
import subprocess
import sys

ROOT = Path(__file__).resolve().parents[1]
# What writes the generated files, in any order.
GENERATORS = (
    ('docs.generate_parameters',),
    ('docs.generate_executables',),
    ('docs.generate_refusals',),
    ('docs.figures.mechanism',),
    ('docs.figures.as_built',),
    ('docs.generate_rooms',),
    (
        'spm_haptic_master',
        'urdf',
        '--output',
        'urdf',
        '--prefix',
        'package://spm_haptic_master/urdf',
    ),
)
# Where generated files are.
PLACES = ('README.md', 'CONTRIBUTING.md', 'docs', 'urdf')


def contents() -> dict[str, str]:
    """Return a digest of each file that may be generated, by its path."""
    found = {}
    for place in PLACES:
        path = ROOT / place
        for file in sorted(path.rglob('*')) if path.is_dir() else [path]:
            if file.is_file() and '__pycache__' not in file.parts:
                digest = hashlib.sha256(file.read_bytes()).hexdigest()
                found[file.relative_to(ROOT).as_posix()] = digest
    return found


def changed(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return the paths of files that are new, gone or different."""
    return sorted(path for path in {*before, *after} if before.get(path) != after.get(path))


def main() -> int:
    """Run the generators; return 1 if one of them fails."""
    before = contents()
    for words in GENERATORS:
        done = subprocess.run(
            [sys.executable, '-m', *words], cwd=ROOT, stdout=subprocess.DEVNULL, check=False
        )
        if done.returncode:
            print(f'docs: {words[0]} failed', file=sys.stderr)
            return 1
    paths = changed(before, contents())
    print('docs: ' + (f'changed: {", ".join(paths)}' if paths else 'nothing changed'))
    return 0


if __name__ == '__main__':
    sys.exit(main())
