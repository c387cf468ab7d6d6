# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sphinx's configuration of the pages, for rosdoc2 (`rosdoc2 build --package-path .`)."""

project = 'spm_haptic_master'
extensions = ['sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx.ext.mathjax', 'myst_parser']
source_suffix = {'.rst': 'restructuredtext', '.md': 'markdown'}
# Anchors of headings, as the pages link them.
myst_heading_anchors = 4
# What a documentation host does not have.
autodoc_mock_imports = [
    'can',
    'canopen',
    'crtk_msgs',
    'diagnostic_msgs',
    'geometry_msgs',
    'launch',
    'matplotlib',
    'msgspec',
    'mujoco',
    'rcl_interfaces',
    'rclpy',
    'rosbag2_py',
    'rosbags',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
    'tf2_msgs',
    'viser',
    'websockets',
    'yaml',
]
