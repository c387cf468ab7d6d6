# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the recipes of the Makefile set for the programs that they start."""

import os
import subprocess

from harness import ROOT
import pytest

pytestmark = pytest.mark.process

NAME = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
RECIPE = f'show: ; @echo "$${NAME}"'


@pytest.mark.parametrize(('given', 'expected'), [
    (None, 'LOCALHOST'), ('SUBNET', 'SUBNET'), ('OFF', 'OFF')])
def test_recipes_stay_on_this_host_unless_the_user_says_otherwise(given, expected):
    environment = {name: value for name, value in os.environ.items() if name != NAME}
    if given is not None:
        environment[NAME] = given
    found = subprocess.run(['make', '--silent', f'--eval={RECIPE}', 'show'], cwd=ROOT,
                           env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == expected
