# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Check a checkout before it is tagged: python -m release [VERSION].

With a version, write it into package.xml and CHANGELOG.rst first, to be committed.
"""

from __future__ import annotations

import argparse
from datetime import date
from pathlib import Path
import sys

from release.checks import CHECKS, prepare, version_of

ROOT = Path(__file__).resolve().parents[1]


def main() -> int:
    """Print the result of each check; return 1 if one found a fault."""
    parser = argparse.ArgumentParser(prog='python -m release', description=__doc__)
    parser.add_argument('version', nargs='?', help='version to prepare, such as 1.0.0')
    version = parser.parse_args().version
    if version:
        try:
            prepare(ROOT, version, date.today())
        except ValueError as error:
            print(f'release: {error}', file=sys.stderr)
            return 1
        print(
            f'package.xml and CHANGELOG.rst have {version}: review and commit them, then run '
            '`make release`'
        )
        return 0
    faulty = False
    for name, check in CHECKS.items():
        faults = check(ROOT)
        faulty |= bool(faults)
        print(f'{name}: {"; ".join(faults) or "as expected"}', flush=True)
    if not faulty:
        print(f'ready: git tag {version_of(ROOT)} && git push origin {version_of(ROOT)}')
    return int(faulty)


if __name__ == '__main__':
    sys.exit(main())
