# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What fkm publishes of a recording: python examples/supervise_recording.py session/measured_js.csv.

The file is one of `recorder`: the time in s, then the angles of four to six joints in rad.
"""

import csv
import sys

import numpy as np
from spm_haptic_master.supervision import supervise

with open(sys.argv[1], newline='') as file:
    _, *rows = csv.reader(file)
stamps = [int(row[0].replace('.', '')) for row in rows]  # ns: nine decimals of a second
angles = np.array([row[1:] for row in rows], dtype=float)

result = supervise(stamps, angles, alert_limit_deg=1.0)

print(
    f'{np.mean(result.published):.1%} of {len(stamps)} orientations published, '
    f'protection level {np.nanmax(result.protection_level, initial=0.0):.2f} deg at most'
)
for index, text in result.state:
    print(f'{1e-9 * (stamps[index] - stamps[0]):8.3f} s  {text}')
for reason, count in result.reasons.most_common():
    print(f'{count:8} withheld: {reason}')
