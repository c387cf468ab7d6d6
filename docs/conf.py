# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sphinx's configuration of the pages, for rosdoc2 (`rosdoc2 build --package-path .`)."""

from pathlib import Path
import sys

project = 'spm_haptic_master'
extensions = ['sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx.ext.mathjax', 'myst_parser']
source_suffix = {'.rst': 'restructuredtext', '.md': 'markdown'}
# Anchors of headings, as the pages link them.
myst_heading_anchors = 4
# What a documentation host may not have.
MOCKED = (
    'can',
    'canopen',
    'cantools',
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
)

# rosdoc2 runs this text in a file of its own, below the checkout: the package is above both.
for folder in Path(__file__).resolve().parents:
    if (folder / project / '__init__.py').is_file():
        sys.path.insert(0, str(folder))
        break


def setup(app):
    """Mock modules once all is configured: rosdoc2 sets `autodoc_mock_imports` by itself."""

    def mock(_, config):
        config.autodoc_mock_imports = [*config.autodoc_mock_imports, *MOCKED]

    app.connect('config-inited', mock)
