# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The paper of Saafi, Laribi and Zeghloul (2015), redrawn figure by figure into docs/paper.

Not installed: `make paper` runs it from the checkout. Imports any room of the package but nodes,
matplotlib and mujoco.
"""
