# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Checks of a checkout before it is tagged, and the two edits that precede them.

Each check takes the root of the checkout and returns the faults that it found, one line each.
"""

from __future__ import annotations

from datetime import date
from pathlib import Path
import re
import subprocess
import sys
import tempfile
from xml.etree import ElementTree

from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import InvalidPackage, parse_package

PACKAGE = 'spm_haptic_master'
# Heading of the changes that no version has yet, in the changelogs of catkin's tools.
FORTHCOMING = 'Forthcoming'
# Domain that stands for an address until there is one (RFC 2606: it never exists).
PLACEHOLDER = 'example.invalid'
VERSION = re.compile(r'\d+\.\d+\.\d+')
# Program that a fresh environment runs on the installed package: no ROS is needed.
TRIAL = (
    'from importlib.metadata import version\n'
    'from spm_haptic_master.kinematics import dexterity, matrix_from_zxz\n'
    'assert 0.0 < dexterity(matrix_from_zxz(2.356, 0.955, 0.0)) < 1.0\n'
    f"print(version('{PACKAGE}'))\n"
)


def version_of(root: Path) -> str:
    """Return the version that package.xml has."""
    return ElementTree.parse(root / 'package.xml').getroot().findtext('version', '')


def tree_faults(root: Path) -> list[str]:
    """Check that everything is committed, and that no tag has the version's name."""
    faults = []
    changed = _run('git', 'status', '--porcelain', directory=root).stdout.splitlines()
    if changed:
        faults.append(f'not committed: {", ".join(line[3:] for line in changed)}')
    version = version_of(root)
    if version in _run('git', 'tag', '--list', directory=root).stdout.split():
        faults.append(f'package.xml: the tag {version} already exists')
    return faults


def manifest_faults(root: Path) -> list[str]:
    """Check package.xml by the reader that ROS's tools use."""
    warnings: list[str] = []
    try:
        parse_package(str(root / 'package.xml')).validate(warnings=warnings)
    except InvalidPackage as error:
        return [f'package.xml: {" ".join(str(error).split())}']
    return [f'package.xml: {warning}' for warning in warnings]


def address_faults(root: Path) -> list[str]:
    """Check that repository and maintainer have an address that exists."""
    text = (root / 'package.xml').read_text(encoding='utf-8')
    lines = [line.strip() for line in text.splitlines() if PLACEHOLDER in line]
    if not lines:
        return []
    return [f'package.xml: {PLACEHOLDER} stands for an address in {", ".join(lines)}']


def version_faults(root: Path) -> list[str]:
    """Check that setup.py has the version of package.xml."""
    done = _run(sys.executable, 'setup.py', '--quiet', '--version', directory=root)
    found = done.stdout.split()[-1:]
    version = version_of(root)
    return (
        []
        if found == [version]
        else [
            f'setup.py: version {" ".join(found) or done.stderr.strip()}; expected {version}, '
            'that of package.xml'
        ]
    )


def changelog_faults(root: Path) -> list[str]:
    """Check that the changelog begins with the version and its date, and lists its changes."""
    version = version_of(root)
    path = root / 'CHANGELOG.rst'
    wrong = f'expected "{version} (YYYY-MM-DD)": `make release ARGS={version}` writes it'
    if f'\n{FORTHCOMING}\n' in path.read_text(encoding='utf-8'):
        return [f'CHANGELOG.rst: {FORTHCOMING} has changes; {wrong}']
    changelog = get_changelog_from_path(str(path), PACKAGE)
    name, day, content = next(changelog.foreach_version(reverse=True), (None, None, []))
    if name != version or not day:
        return [f'CHANGELOG.rst: begins with {name}; {wrong}']
    return [] if content else [f'CHANGELOG.rst: {version} has no changes']


def build_faults(root: Path) -> list[str]:
    """Check that sdist and wheel build, and that the wheel works in a fresh environment."""
    version = version_of(root)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        steps = (
            (
                sys.executable,
                'setup.py',
                '--quiet',
                'egg_info',
                '--egg-base',
                name,
                'sdist',
                '--dist-dir',
                name,
            ),
            # The wheel of the sdist: what the sdist lacks, no user of it has.
            (
                sys.executable,
                '-m',
                'pip',
                '--quiet',
                'wheel',
                '--no-deps',
                '--wheel-dir',
                name,
                str(folder / f'{PACKAGE}-{version}.tar.gz'),
            ),
            (sys.executable, '-m', 'venv', '--without-pip', str(folder / 'venv')),
            (
                sys.executable,
                '-m',
                'pip',
                '--quiet',
                '--python',
                str(folder / 'venv' / 'bin' / 'python'),
                'install',
                '--no-compile',
                str(folder / f'{PACKAGE}-{version}-py3-none-any.whl'),
            ),
            (str(folder / 'venv' / 'bin' / 'python'), '-c', TRIAL),
        )
        for step in steps:
            done = _run(*step, directory=folder if step[1:2] == ('-c',) else root)
            if done.returncode:
                last = (done.stderr or done.stdout).strip().splitlines()[-1:]
                return [f'{" ".join(step[:4])} ...: {"".join(last)}']
    return (
        []
        if done.stdout.split() == [version]
        else [f'the installed version is {done.stdout.strip()}; expected {version}']
    )


CHECKS = {
    'tree': tree_faults,
    'package.xml': manifest_faults,
    'address': address_faults,
    'version': version_faults,
    'changelog': changelog_faults,
    'sdist and wheel': build_faults,
}


def prepare(root: Path, version: str, day: date) -> None:
    """
    Write the version into package.xml, and it and the day above the forthcoming changes.

    Raises
    ------
    ValueError
        The version does not consist of three numbers, or nothing is forthcoming.

    """
    if not VERSION.fullmatch(version):
        raise ValueError(f'version {version!r}; expected three numbers such as 1.0.0')
    changelog = root / 'CHANGELOG.rst'
    text = changelog.read_text(encoding='utf-8')
    above = f'{FORTHCOMING}\n{"-" * len(FORTHCOMING)}\n'
    if above not in text:
        raise ValueError(f'CHANGELOG.rst has no section {FORTHCOMING}; expected one')
    heading = f'{version} ({day.isoformat()})'
    changelog.write_text(
        text.replace(above, f'{heading}\n{"-" * len(heading)}\n', 1), encoding='utf-8'
    )
    manifest = root / 'package.xml'
    manifest.write_text(
        re.sub(
            r'(<version>)[^<]*(</version>)',
            rf'\g<1>{version}\g<2>',
            manifest.read_text(encoding='utf-8'),
            count=1,
        ),
        encoding='utf-8',
    )


def _run(*command: str, directory: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=directory, capture_output=True, text=True)
