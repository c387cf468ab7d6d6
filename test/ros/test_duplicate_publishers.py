# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A process that finds another publisher on its topics, where the other's name comes late."""

import pytest
from spm_haptic_master.exceptions import RivalError
from spm_haptic_master.ros import duplicate_publishers


class LonelyNode:
    """A node that resolves names, and is nothing else."""

    def __init__(self, name, **settings):
        self.name = name

    def resolve_topic_name(self, topic):
        return f'/{topic}'

    def destroy_node(self):
        pass


@pytest.fixture
def said(monkeypatch):
    """Return what is said about a publisher whose node's name comes in the third look."""
    lines, looks = [], iter([duplicate_publishers.NO_NAME] * 2)
    monkeypatch.setattr(duplicate_publishers, 'Node', LonelyNode)
    monkeypatch.setattr(duplicate_publishers, 'LOOK_PERIOD', 0.02)
    monkeypatch.setattr(duplicate_publishers, 'publishers',
                        lambda node, topic: (next(looks, '/fkm'),))
    monkeypatch.setattr(duplicate_publishers.node_log, 'warning',
                        lambda node, text: lines.append(text))
    return lines


def test_a_name_that_comes_after_the_first_warning_is_said(monkeypatch, said):
    monkeypatch.setattr(duplicate_publishers, 'LOOK', 0.01)
    monkeypatch.setattr(duplicate_publishers, 'LONGEST_WAIT', 0.2)
    with pytest.raises(RivalError, match='/orientation is published by /fkm already'):
        duplicate_publishers.wait_until_alone({'fkm': 'orientation'}, lambda: False)
    assert [line.split(' already')[0] for line in said] == [
        'nothing published: /orientation is published by a node without a name',
        'nothing published: /orientation is published by /fkm']


def test_a_busy_machine_looks_longer(monkeypatch, said):
    looks = []
    monkeypatch.setattr(duplicate_publishers, 'LOOK', 0.03)
    monkeypatch.setattr(duplicate_publishers, 'LONGEST_ROUND', 0.01)
    monkeypatch.setattr(duplicate_publishers, 'LOOK_PERIOD', 0.05)
    monkeypatch.setattr(duplicate_publishers, 'publishers',
                        lambda node, topic: looks.append(topic) or ())
    duplicate_publishers.wait_until_alone({'fkm': 'orientation'}, lambda: False)
    # The first round takes no time.
    assert len(looks) >= 4


def test_a_name_that_comes_soon_is_all_that_is_said(monkeypatch, said):
    monkeypatch.setattr(duplicate_publishers, 'LOOK', 0.1)
    monkeypatch.setattr(duplicate_publishers, 'LONGEST_WAIT', 0.3)
    with pytest.raises(RivalError):
        duplicate_publishers.wait_until_alone({'fkm': 'orientation'}, lambda: False)
    assert len(said) == 1 and '/fkm already' in said[0]
