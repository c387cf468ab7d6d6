# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Study of more sensors: python -m study [--output DIR] [--accept]."""

from __future__ import annotations

from pathlib import Path
import sys

from paper.figure_entry import table
from paper.verdicts import COLUMN, PAGE, run_page

# Directory of the page in the repository.
DEFAULT_OUTPUT = Path(__file__).resolve().parents[1] / 'docs' / 'sensors'

# Head of the page, Markdown.
HEAD = """\
# How many sensors, and where

The paper asks where one extra sensor has to sit so that the orientation is accurate: on th3A.
Here the same question is asked of integrity: how wrong can one faulty sensor make the
orientation before it is detected?

In words: with a fifth sensor on th3B every single fault is seen everywhere, the singularity
included. With a sixth on th3C the faulty sensor is also known everywhere, so that the device can
go on through any single failure.

```
make study
```

computes each number on this page and draws each picture beside it.

**Level**, the part of the protection level that a fault causes: H (N × 3) are the rates of the N
sensors, K = pinv(H), P = I − H K. A fault of sensor i turns the orientation by |K_i| a unit and
moves the parity vector, N − 3 numbers, by |P_i|. It is detected where the mean parity of {window}
samples is beyond {false:g} of its standard deviations and what nominal biases explain; with a
missed detection of 1e-7 the level is

    max_i |K_i| / |P_i| · (({false:g} + {missed:g}) σ / √{window} + b √N)

with σ = {sigma:g} deg and b = {bias:g} deg for every sensor, and the geometry of the paper. `fkm`
adds what noise and biases do to a healthy orientation, and with four sensors its bound of the
biases is sharper ([safety](../safety.md)).

**Isolated step**: a step of a sensor of which every other sensor's fault leaves {isolation:g}
standard deviations of that mean unexplained: the number with which the steps of the model below
come out. The parity vector then points along the column of P of the faulty sensor.
"""


def main(args: list[str] | None = None) -> int:
    """Draw all figures and write the page; return 1 after an error, or if a verdict changed."""
    return run_page(
        'study',
        'Computes what a fifth and a sixth sensor are worth, and writes a page about it.',
        DEFAULT_OUTPUT,
        _make,
        args,
    )


def _make(output: Path) -> None:
    from study import nine_joints, placement, protection_maps

    head = HEAD.format(
        window=nine_joints.WINDOW,
        false=nine_joints.FALSE_ALARM,
        sigma=nine_joints.SIGMA,
        missed=nine_joints.MISSED_DETECTION,
        bias=nine_joints.BIAS,
        isolation=nine_joints.ISOLATION,
    )
    found = placement.sections(output), protection_maps.sections(output)
    rows = [row for glance, _ in found for row in glance]
    text = '\n'.join(
        [
            head,
            '## At a glance\n',
            table(('', COLUMN), rows),
            '',
            *(section for _, sections in found for section in sections),
        ]
    )
    (output / PAGE).write_text(text, encoding='utf-8')


if __name__ == '__main__':
    sys.exit(main())
