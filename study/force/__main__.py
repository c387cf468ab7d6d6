# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Study of force feedback: python -m study.force [--output DIR] [--accept]."""

from __future__ import annotations

from pathlib import Path
import sys

from paper.verdicts import PAGE, run_page

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

## A session

![A session: angle, torque, motors, energy and states over time](feel.png)

A hand turns the handle. A slave follows it and touches a wall of 1 N m/rad; its wrench comes back
30 ms late, at 200 Hz. The hand pushes on across the singular surface, presses the clutch, and then
wrench, encoder and drive are lost in turn. Without wrenches it leads the handle over its end stop,
and at last the master is lost. `make feel` plays it alone, in some seconds:

```
{feel}
```

From the top: where the handle is and where it meets the wall; what the slave asks for and what the
hand feels; what the motors do; the energy that they gave; `force_state`. The clutch lets the
wrench go, and it comes back when it has been small. Next to the singular surface the hand feels
nothing about the handle. After each loss the torque is zero within the limit of the table, and
comes back by the same way as at the start.

## Motor torque for a torque on the handle

![Worst motor torque for 1 N m on the handle](motor_torque.png)

At the parallel singularity three motors have no torque about one direction of the handle, near its
own axis. A fourth motor on th3A has. Worst motor, N m for 1 N m on the handle, over the workspace
(tilt up to 20 deg, φ 0 to 95 deg, random directions):

{motor_torque}

## The fade

![Rendered torque and motor torque across the singular surface](fade.png)

Over {faded} of φ three motors render less roll torque than is asked for. It goes down by less than
1 N m/rad to 0.05 N m, then by the fade to none, 2.4 deg from the surface. The motor torque changes
its sign there without a step.

A hand that pushes against 0.3 N m of roll loses its hold at the surface. Its grip is a spring; it
moves by 0.9 rad in 4 s, itself at up to 0.34 rad/s. Peak speed of the handle, rad/s, without
`force.speed_limit`, by the hand's stiffness and by what bounds the torque there; beside it the
share of poses and directions of the workspace at which 0.3 N m is rendered exactly:

{crossing}

The fade alone is a slope of the torque that is steeper than a relaxed hand: the hand is thrown.
Damping and a slower slew rate change nothing, less torque little, and a wider fade throws a
relaxed hand farther. A gentler slope helps, and costs exactness further away: the bound of 1.4
from 0.2 of `sigma_off` leaves three poses of four exact.

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

## A motor that is wired wrongly

A free handle is touched, with a wrench of zero and `force.speed_limit` of 6 rad/s. A motor in the
wrong sense makes a drive of the damping, and nothing but the speed shows it: what the motors seem
to take is what a hand would give. Motors that are swapped do nothing with so little torque.
`force_check` finds all of these before the first torque.

{wiring}

## Limits

{limits}

Further limits are tests: the static map against MuJoCo and gravity (`test_static_map.py`), four
motors (`test_motor_torques.py`), slow loops and hands in the fade zone (`test_energy.py`,
`test_closed_loop.py`), engaging, losses and 10,000 random transitions (`test_states.py`). `make
bench` has the cost of a sample.
"""


def main(args: list[str] | None = None) -> int:
    """Draw all pictures and write the page; return 1 after an error."""
    return run_page(
        'force',
        'Draws force feedback in simulated time, and a page about it.',
        DEFAULT_OUTPUT,
        _make,
        args,
    )


def _make(output: Path) -> None:
    from study.force import dynamics_pictures as dynamics
    from study.force import statics_pictures as statics
    from study.force.crossing import crossing
    from study.force.feel_picture import draw, figures
    from study.force.hand_figures import wiring_table
    from study.force.limits_table import limits_table
    from study.force.session import play

    session = play()
    draw(session, output / 'feel.png')
    text = TEXT.format(
        feel=figures(session)[0].strip('\n'),
        motor_torque=statics.motor_torque(output / 'motor_torque.png'),
        faded=statics.fade(output / 'fade.png'),
        crossing=crossing(),
        z_width=dynamics.z_width(output / 'z_width.png'),
        energy=dynamics.energy(output / 'energy.png'),
        loss=dynamics.loss(output / 'loss.png'),
        wiring=wiring_table(),
        limits=limits_table(),
    )
    (output / PAGE).write_text(text, encoding='utf-8')
    print(text[text.index('## The fade') : text.index('## Stiffness')].strip())
    print(text[text.index('## Limits') :].strip())


if __name__ == '__main__':
    sys.exit(main())
