# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Study of force feedback: python -m study.force [--output DIR] [--accept]."""

from __future__ import annotations

from pathlib import Path
import sys

from paper.page_command import PAGE, run_page

# Directory of the page in the repository.
DEFAULT_OUTPUT = Path(__file__).resolve().parents[2] / 'docs' / 'force'

# The page, Markdown.
TEXT = """\
# Force feedback in simulated time

The room `spm_haptic_master/force` on MuJoCo's model of the closed chain, with encoders of 0.04 deg
and 14 bit, a hand, and a slave behind delays ([what it does and why](../force.md)).

```
make force
```

computes each number on this page and draws each picture beside it.

## Motor torque for a torque on the handle

![Worst motor torque for 1 N m on the handle](motor_torque.png)

At the parallel singularity three motors have no torque about one direction of the handle, near its
own axis. A fourth motor on th3A has. Worst motor, N m for 1 N m on the handle, over the workspace
(tilt up to 20 deg, φ 0 to 95 deg, random directions):

{motor_torque}

## The fade

![Rendered torque and motor torque across the singular surface](fade.png)

Over {faded} of φ three motors render less roll torque than is asked for: first as they are at
their limit of 0.5 N m, next to the surface by the fade. The motor torque changes its sign across
the surface without a step.

A hand that pushes against 0.3 N m of roll loses its hold at the surface. Its grip is a spring; it
moves by 0.9 rad in 4 s, itself at up to 0.34 rad/s. The handle reaches:

{crossing}

## Stiffness against latency

![Largest stable stiffness against the law](z_width.png)

A spring that is computed beside the device, on a free handle, by damping alone. The law is
K < (b + B) / (T / 2 + t_d), with the viscous friction b, the damping B, the period T and the
latency t_d.

{z_width}

The law takes the damping for immediate. A velocity over 10 ms lags, so that B helps less against a
stiff spring.

## Energy

![Energy that the motors gave, with and without the energy law](energy.png)

Largest energy that the motors gave in all:

{energy}

## The loss of a wrench

![Motor torques after the last wrench](loss.png)

A wrench counts as lost after 30 ms; torque is zero {loss} after the last one.
"""


def main(args: list[str] | None = None) -> int:
    """Draw all pictures and write the page; return 1 after an error."""
    return run_page('force', 'Draws force feedback in simulated time, and a page about it.',
                    DEFAULT_OUTPUT, _make, args)


def _make(output: Path) -> None:
    from study.force import dynamics_pictures as dynamics
    from study.force import statics_pictures as statics
    text = TEXT.format(
        motor_torque=statics.motor_torque(output / 'motor_torque.png'),
        faded=statics.fade(output / 'fade.png'), crossing=dynamics.crossing(),
        z_width=dynamics.z_width(output / 'z_width.png'),
        energy=dynamics.energy(output / 'energy.png'),
        loss=dynamics.loss(output / 'loss.png'))
    (output / PAGE).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    sys.exit(main())
