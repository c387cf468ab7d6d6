# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Draw the parallel singularity in the workspace: python examples/singularity.py [PICTURE].

The cells run one by one in an editor or notebook that knows `# %%`. It needs matplotlib.
"""

# %% What the models say
from math import radians
import sys

from matplotlib import pyplot
import numpy as np
from spm_haptic_master.kinematics import dexterity, singularity_locus, workspace_pose

figure, (turn, cone) = pyplot.subplots(1, 2, figsize=(10, 4.5), layout='constrained')

# %% The handle turns about its own axis, in the middle of the workspace: three sensors lose it
phi = np.linspace(0.0, 90.0, 721)
poses = workspace_pose(0.0, 0.0, np.radians(phi))
for sensors in 3, 4:
    turn.plot(phi, dexterity(poses, sensors=sensors), label=f'{sensors} sensors')
turn.set(xlabel='self-rotation, deg', ylabel='dexterity')
turn.legend()

# %% The handle tilts: at each self-rotation the singular poses are a line through the workspace
for degrees in 30, 40, 50, 60:
    tilt, azimuth = singularity_locus(radians(degrees), half_angle=radians(26))
    cone.plot(
        np.degrees(tilt) * np.cos(azimuth),
        np.degrees(tilt) * np.sin(azimuth),
        '.',
        markersize=2,
        label=f'self-rotation {degrees} deg',
    )
cone.set(xlabel='tilt, deg', ylabel='tilt, deg', aspect='equal', xlim=(-27, 27), ylim=(-27, 27))
cone.legend(fontsize='small')

# %% Look at it
if len(sys.argv) > 1:
    figure.savefig(sys.argv[1])
else:
    pyplot.show()
