# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Servers of the page, a device on it and the node `view`, in the process of the tests."""

from functools import cache
import gc
from importlib.util import find_spec
import os
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from spm_haptic_master.parameters.resolver import Parameters

# Without viser (extra view) there is no page; `view` says so.
collect_ignore_glob = [] if find_spec('viser') else ['test_[!v]*.py']
# Longest wait (s).
PATIENCE = 20.0


@pytest.fixture(scope='module')
def serve():
    """Make servers of the page, each at an address and with further names of its own."""
    from spm_haptic_master.view.server import serve

    servers = []

    @cache
    def make(host='127.0.0.1', names=''):
        servers.append(serve(host, 28780, names, lambda _: None))
        return servers[-1]

    yield make
    for each in servers:
        each.stop()


@pytest.fixture
def shown(serve, monkeypatch):
    """Give a device on a page that has not begun."""
    from shown_device import sampled, Shown
    from spm_haptic_master.view import arm, topics

    server = serve()
    server.gui.reset()
    server.scene.reset()
    made = Shown(server)
    monkeypatch.setattr(arm, 'time', SimpleNamespace(monotonic=lambda: made.now))
    monkeypatch.setattr(topics, 'SampledTopic', sampled)
    monkeypatch.setattr(server, 'get_clients', lambda: {0: None} if made.watched else {})
    return made


@pytest.fixture
def view(observer, monkeypatch):
    """Give the node `view`; it runs while `spin` waits for a condition."""
    from spm_haptic_master.view.node import View

    monkeypatch.setattr('spm_haptic_master.view.node.FIND_PERIOD', 0.1)
    monkeypatch.setattr('spm_haptic_master.view.node.NEWS_PERIOD', 0.1)
    rclpy.init()
    # The process that it goes with is this one.
    done = Future()
    node = View(Parameters(arguments=['view.port:=28480', f'view.process:={os.getpid()}']), done)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.spin = lambda condition, patience=PATIENCE: observer.spin_until(
        lambda: executor.spin_once(0.01) or condition(), patience
    )
    node.has_ended = done.done
    yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    gc.unfreeze()
