# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How fast a process finds the others: the profile of Fast DDS in config/fastdds.xml.

Where its answer to a new process is lost, that waits for an announcement, by default 3 s.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from spm_haptic_master.parameters.files import config_directory

# Environment variables that name a file of profiles: of Fast DDS 2, which Jazzy has, and of 3.
VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
# Files of profiles that Fast DDS reads in the working directory.
LOCAL_FILES = ('DEFAULT_FASTRTPS_PROFILES.xml', 'DEFAULT_FASTDDS_PROFILES.xml')


def profile(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that select the package's profile; none if the user has one."""
    if any(environment.get(name) for name in VARIABLES) \
            or any(Path(name).exists() for name in LOCAL_FILES):
        return {}
    return dict.fromkeys(VARIABLES, str(config_directory() / 'fastdds.xml'))
