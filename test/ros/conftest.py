# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nodes in the process of the test."""

import pytest
import rclpy


@pytest.fixture
def make_node():
    """Return a function that makes a node as of a process of its own."""
    nodes = []

    def make_node(name, **settings):
        context = rclpy.Context()
        rclpy.init(context=context)
        nodes.append(rclpy.create_node(name, context=context, **settings))
        return nodes[-1]

    yield make_node
    for node in nodes:
        node.destroy_node()
        node.context.try_shutdown()
