# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each check before a release finds its fault, and nothing in a checkout that is ready."""

from datetime import date
import shutil
import subprocess
import sys

from harness import ROOT
import pytest

sys.path.insert(0, str(ROOT))
checks = pytest.importorskip('release.checks')
FILES = ('package.xml', 'CHANGELOG.rst', 'setup.py', 'setup.cfg', 'pyproject.toml', 'LICENSE')
DAY = date(2027, 3, 4)


@pytest.fixture
def ready(tmp_path):
    """Return a checkout without git, prepared as version 3.2.1."""
    for name in FILES:
        shutil.copy(ROOT / name, tmp_path)
    for name in ('resource', 'spm_haptic_master'):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns('__pycache__'))
    changelog = tmp_path / 'CHANGELOG.rst'
    if '\nForthcoming\n' not in changelog.read_text():  # a checkout that is to be tagged
        replace(changelog, '^\n\n', '^\n\nForthcoming\n-----------\n* Add a change.\n\n')
    checks.prepare(tmp_path, '3.2.1', DAY)
    return tmp_path


def replace(path, before, after):
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


def test_preparing_names_version_and_day_once_and_another_changelog_is_found(ready):
    changelog = ready / 'CHANGELOG.rst'
    assert checks.version_of(ready) == '3.2.1'
    assert changelog.read_text().count(f'3.2.1 (2027-03-04)\n{"-" * 18}\n') == 1
    assert checks.changelog_faults(ready) == checks.manifest_faults(ready) == []
    for version, words in (
        ('3.2.2', 'Forthcoming'),
        *((each, 'expected three numbers') for each in ('1.0', 'v1.0.0', '1.0.0rc1', '')),
    ):
        with pytest.raises(ValueError, match=words):
            checks.prepare(ready, version, DAY)
    replace(changelog, '3.2.1 (', '3.2.0 (')
    (fault,) = checks.changelog_faults(ready)
    assert 'begins with 3.2.0; expected "3.2.1 (YYYY-MM-DD)"' in fault
    replace(changelog, '3.2.0 (', 'Forthcoming\n-----------\n* Add a song.\n\n3.2.1 (')
    (fault,) = checks.changelog_faults(ready)
    assert fault.startswith('CHANGELOG.rst: Forthcoming has changes')


def test_a_manifest_that_ros_does_not_take_is_found(ready):
    replace(ready / 'package.xml', 'email="maintainers@', 'email="maintainers')
    assert checks.manifest_faults(ready)


def test_a_placeholder_of_an_address_is_found(ready):
    (fault,) = checks.address_faults(ready)
    assert fault.count('example.invalid') == 5
    text = (ready / 'package.xml').read_text()
    (ready / 'package.xml').write_text(text.replace('example.invalid', 'spherical.example.org'))
    assert checks.address_faults(ready) == []


@pytest.mark.process
def test_a_version_of_setup_and_a_changed_tree_and_an_existing_tag_are_found(ready):
    assert checks.version_faults(ready) == []
    replace(ready / 'setup.py', 'version=VERSION', "version='9.9.9'")
    (fault,) = checks.version_faults(ready)
    assert '9.9.9' in fault
    assert 'expected 3.2.1' in fault

    def git(*arguments):
        subprocess.run(
            ['git', '-c', 'user.name=a', '-c', 'user.email=a@b.c', *arguments],
            cwd=ready,
            check=True,
            capture_output=True,
        )

    git('init')
    git('add', *FILES)
    git('commit', '-m', 'Begin')
    (ready / '.git' / 'info' / 'exclude').write_text('spm_haptic_master\n')
    assert checks.tree_faults(ready) == []
    (ready / 'LICENSE').write_text('mine')
    (fault,) = checks.tree_faults(ready)
    assert fault == 'not committed: LICENSE'
    git('tag', '3.2.1')
    assert len(checks.tree_faults(ready)) == 2


@pytest.mark.packaging
def test_a_package_without_its_rooms_is_found(ready, monkeypatch):
    """Before anything that it depends on is missed, which is not installed here."""
    monkeypatch.setenv('PIP_NO_DEPS', '1')
    replace(ready / 'setup.py', "include=[PACKAGE, f'{PACKAGE}.*']", 'include=[PACKAGE]')
    (fault,) = checks.build_faults(ready)
    assert "No module named 'spm_haptic_master.kinematics'" in fault
