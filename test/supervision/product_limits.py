# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The limits of the product, for tests that need some of them otherwise."""

from dataclasses import replace

from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.limits import Limits, limits_from, THREE
from spm_haptic_master.parameters.setting import complete


def product_limits(degraded=False, **changed) -> Limits:
    """Return the limits of fkm's default parameters, some fields changed."""
    if degraded:
        changed['fewest_sensors'] = THREE
    return replace(limits_from(complete(SUPERVISION_SETTINGS, {})), **changed)
