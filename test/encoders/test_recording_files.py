# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of a recording: whole rows, and nothing overwritten."""

import pytest
from spm_haptic_master.encoders.recording_files import Table, write_new
from spm_haptic_master.exceptions import InputError


def test_a_table_is_made_with_its_first_row_and_no_file_is_overwritten(tmp_path):
    path = tmp_path / 'made' / 'table.csv'
    table = Table(path, ('x', 'y'))
    assert (table.rows, table.span, path.exists()) == (0, (0, 0), False)
    for stamp in (1_000_000_001, 2_000_000_000, 3_000_000_000):
        table.write(stamp, (1.0, -2.5))
    table.close()
    assert path.read_text() == 'time,x,y\n' + ''.join(
        f'{time},1.000000000,-2.500000000\n' for time in ('1.000000001', '2.000000000',
                                                          '3.000000000'))
    assert (table.rows, table.span) == (3, (1_000_000_001, 3_000_000_000))
    write_new(tmp_path / 'rig' / 'rig.json', '{}')
    for again in (lambda: Table(path, ()), lambda: write_new(tmp_path / 'rig' / 'rig.json', '')):
        with pytest.raises(InputError, match='already exists; choose another directory'):
            again()
    assert (tmp_path / 'rig' / 'rig.json').read_text() == '{}'


def test_what_cannot_be_written_is_named(tmp_path):
    (tmp_path / 'file').write_text('')
    path = tmp_path / 'file' / 'table.csv'
    for attempt in (lambda: Table(path, ()).write(0, ()), lambda: write_new(path, '')):
        with pytest.raises(InputError, match='table.csv: cannot be written: '):
            attempt()
