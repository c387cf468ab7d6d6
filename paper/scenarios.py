# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figs. 16 to 26: four forward models on a motion through the singularity, two noise levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path

import mujoco
import numpy as np
from paper.figure_entry import Entry, table, Verdict, verdict
from paper.geometry_figures import central_singularity
from paper.linkage_drawing import Linkage
from paper.mode_branches import fig9_motion, SECONDS
from paper.mujoco_model import MultiBody
from paper.sensor_placement import nearest_modes
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics import (
    estimate,
    forward_theta3a,
    Geometry,
    inverse,
    track_mode,
    workspace_pose,
    zxz_from_matrix,
)
from spm_haptic_master.validation import plot_style

# The paper's link angles.
G = Geometry()
# Time between two samples (s).
STEP = 0.05
# Noise of each sensor (rad, 1 standard deviation), as measured in the paper.
SIGMA = radians(0.04)
# Seed of the noise.
SEED = 2015
# Constraint error, for links of length 1, beyond which the multi-body model is not assembled.
OPEN = 1e-9
# Printed largest errors without noise (deg).
PRINTED_CLASSIC, PRINTED_MULTI_BODY, PRINTED_IMPROVED = 15e-3, 5e-3, 1e-14
# Printed bound of the improved model's error with noise (deg).
PRINTED_NOISY = 0.015
# Distance from the singularity that counts as near (deg).
NEAR = 1.0
# Line styles of the models.
MODELS = {
    'classic': {'color': plot_style.CLASSIC, 'label': 'classic FKM'},
    'multi-body': {'color': plot_style.MULTI_BODY, 'label': 'multi-body model (MuJoCo)'},
    'improved': {'color': plot_style.IMPROVED, 'label': 'improved FKM'},
    'estimate': {'color': plot_style.ESTIMATE, 'label': 'estimate'},
}


@dataclass(frozen=True, slots=True)
class Run:
    """
    Self-rotations during one motion.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Times, s.
    phi : ndarray, shape (n,)
        Imposed self-rotation, deg.
    found : dict of str to ndarray, shape (n,)
        Self-rotation by each model, deg; NaN where it has no answer.

    """

    time: np.ndarray
    phi: np.ndarray
    found: dict[str, np.ndarray]

    def error(self, model: str) -> np.ndarray:
        """Return a model's self-rotation minus the imposed one, deg."""
        return self.found[model] - self.phi


def entries(out: Path, step: float = STEP) -> list[Entry]:
    """Draw into the directory `out` and return the entries of the page."""
    time = np.arange(0.0, SECONDS + 0.5 * step, step)
    R = fig9_motion(time)
    noise = SIGMA * np.random.default_rng(SEED).normal(size=(len(time), 4))
    exact = solve(time, R, np.zeros_like(noise), followed=True)
    noisy = solve(time, R, noise * [1.0, 1.0, 1.0, 0.0])
    every = solve(time, R, noise)
    return [
        _first(),
        _multi_body_model(),
        _exact(out, exact),
        _second(),
        _noisy(out, noisy, every),
        _tracking(R, noise),
    ]


def solve(time: np.ndarray, R: np.ndarray, noise: np.ndarray, followed: bool = False) -> Run:
    """
    Solve every model from the joint angles of R with noise on th1A, th1B, th1C, th3A.

    `time` (n,) in s, `R` (n, 3, 3) imposed orientations, `noise` (n, 4) in rad. The multi-body
    model continues its own last motion if `followed`; otherwise each search begins at the imposed
    orientation.
    """
    joints = inverse(R)
    th1, th3a = joints.theta1 + noise[:, :3], joints.theta3a + noise[:, 3]
    found = {
        'classic': nearest_modes(th1, R),
        'multi-body': multi_body(th1, R[:1] if followed else R),
        'improved': forward_theta3a(th1, th3a),
        'estimate': estimate(th1, th3a, SIGMA).rotation,
    }
    return Run(time, _phi(R), {name: _phi(each) for name, each in found.items()})


def _phi(R: np.ndarray) -> np.ndarray:
    phi = np.full(len(R), np.nan)
    known = np.isfinite(R[:, 0, 0])
    phi[known] = np.degrees(zxz_from_matrix(R[known])[2])
    return phi


def multi_body(th1: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """
    Return the multi-body model's orientations, NaN where its constraints stay open.

    `th1` (n, 3) in rad. Each search begins at its row of `starts`, (n, 3, 3); if there is only the
    first one, where the joints would be if they continued their last motion, as in a simulation.
    """
    body = MultiBody(G)
    found = np.full((len(th1), 3, 3), np.nan)
    motion = np.zeros_like(body.data.qpos)
    for row, angles in enumerate(th1):
        before = body.data.qpos.copy()
        if row < len(starts):
            body.place(angles, starts[row])
        else:
            body.data.qpos += motion
        rotation, error = body.assemble(angles)
        if error < OPEN:
            found[row] = rotation
        motion = body.data.qpos - before if row else motion
    return found


def _size(error: np.ndarray) -> str:
    known = np.abs(error[np.isfinite(error)])
    return f'{known.max():.2g}'


def _statistics(run: Run, name: str) -> tuple[object, ...]:
    error = run.error(name)
    near = np.abs(run.phi - degrees(central_singularity())) < NEAR

    def rms(part: np.ndarray) -> str:
        known = error[part & np.isfinite(error)]
        return f'{np.sqrt(np.mean(known**2)):.2g}' if known.size else 'none'

    return (MODELS[name]['label'], _size(error), rms(near), rms(~near), int(np.isnan(error).sum()))


# Header of the tables of errors.
HEADER = (
    'error of φ, deg',
    'largest',
    f'rms within {NEAR:g} deg of the singularity',
    'rms elsewhere',
    'samples without an answer',
)


def _flow(noise: str) -> str:
    return (
        '```mermaid\nflowchart LR\n'
        '  A["φ = 45 + 10 sin(π t / 10) deg<br>ψ, θ at the centre"] --> B["inverse model"]\n'
        f'  B --> N["{noise}"]\n'
        '  N -- "th1A, th1B, th1C" --> C["classic FKM"]\n'
        '  N -- "th1A, th1B, th1C" --> D["multi-body model"]\n'
        '  N -- "th1A, th1B, th1C, th3A" --> E["improved FKM"]\n'
        '  N -- "th1A, th1B, th1C, th3A" --> H["estimate"]\n'
        '  C & D & E & H --> F["φ against the imposed one"]\n```'
    )


def _first() -> Entry:
    return Entry(
        (16,),
        'First scenario',
        'A flowchart: reference trajectory, inverse model, three forward models. Only the '
        'self-rotation moves, around 50 deg; ψ = 135, θ = 54 deg.',
        'The same with a fourth model, `estimate`. The motion is that of Fig. 9.',
        Verdict.AGREES,
        'The print has no trajectory; that of Fig. 9 passes the singularity twice. θ is the '
        "centre's 54.7356 deg.",
        details=_flow('no noise'),
    )


def _multi_body_model() -> Entry:
    model = MultiBody(G).model
    names = ['base', *(model.body(i).name for i in range(1, model.nbody))]
    lines = ['```mermaid', 'flowchart LR']
    for i in range(1, model.nbody):
        parent, count = names[model.body_parentid[i]], model.body_jntnum[i]
        joint = model.joint(model.body_jntadr[i]).name if count else ''
        lines.append(
            f'  {parent} -- "{joint}" --> {names[i]}' if count else f'  {parent} --- {names[i]}'
        )
    lines += [
        '  distal_b -. "tip held" .- platform',
        '  distal_c -. "tip held" .- platform',
        '```',
    ]
    return Entry(
        (17,),
        'The multi-body model',
        'The SimMechanics diagram: nine revolute joints, base, end-effector; active angles in, '
        'orientation out.',
        f'MuJoCo {mujoco.__version__}, generated from α, β, γ: {model.njnt} hinges and '
        f'{model.neq} point constraints where legs B and C hold the platform. Active angles in, '
        'orientation out; it uses no formula of the package.',
        verdict(model.njnt + model.neq == 9),
        'The joints 3B and 3C are the point constraints: with all axes through one centre, a '
        'point fixed on the axis allows the same motion as a hinge.',
        details='\n'.join(lines),
    )


def _draw(
    run: Run, title: str, log: bool, numbers: Sequence[int], printed: dict[str, float], path: Path
) -> None:
    figure = plot_style.new_figure(height=6.2)
    axes = figure.subplots(2, 2, sharex=True).ravel()
    singular = degrees(central_singularity())
    axes[0].plot(
        run.time, run.phi, color=plot_style.REFERENCE, linewidth=3.0, alpha=0.25, label='imposed'
    )
    for model, style in MODELS.items():
        axes[0].plot(run.time, run.found[model], linewidth=1.0, **style)
    axes[0].axhline(singular, color='#777777', linewidth=0.8, linestyle=':')
    axes[0].legend(fontsize=7)
    plot_style.label_axes(axes[0], '', 'φ, deg', f'Fig. {numbers[0]}: {title}')
    panels = (('classic',), ('multi-body',), ('estimate', 'improved'))
    for place, models, number in zip(axes[1:], panels, numbers[1:], strict=True):
        for model in models:
            error = run.error(model)
            place.plot(
                run.time,
                np.maximum(np.abs(error), 1e-17) if log else error,
                linewidth=0.9,
                **MODELS[model],
            )
        level = printed.get(models[-1])
        for bound in () if level is None else (level,) if log else (level, -level):
            place.axhline(
                bound,
                color='black',
                linewidth=0.9,
                linestyle='--',
                label=f'printed: {level:g} deg' if bound > 0.0 else None,
            )
        if log:
            place.set_yscale('log')
            place.set_ylim(1e-16, 1.0)
        place.legend(fontsize=7)
        plot_style.label_axes(
            place,
            '',
            '|error of φ|, deg' if log else 'error of φ, deg',
            f'Fig. {number}: {" and ".join(models[::-1])}',
        )
    for place in axes[2:]:
        place.set_xlabel('time, s')
    plot_style.save(figure, path)


def _closure_error(phi_error: float) -> float:
    """Return the loops' closure error at a self-rotation off the singular pose by some deg."""
    phi = central_singularity()
    th1 = inverse(workspace_pose(0.0, 0.0, phi)).theta1
    off = Linkage.at(th1, workspace_pose(0.0, 0.0, phi + radians(phi_error)), G)
    return float(np.abs(np.sum(off.second * off.third, axis=-1) - np.cos(G.betas)).max())


def _exact(out: Path, run: Run) -> Entry:
    printed = {
        'classic': PRINTED_CLASSIC,
        'multi-body': PRINTED_MULTI_BODY,
        'improved': PRINTED_IMPROVED,
    }
    _draw(run, 'no noise', True, (18, 19, 20, 21), printed, out / 'fig18_21.png')
    improved = float(np.abs(run.error('improved')).max())
    worst = float(np.nanmax(np.abs(run.error('classic'))))
    opened = [_closure_error(each) for each in (PRINTED_CLASSIC, PRINTED_MULTI_BODY)]
    return Entry(
        (18, 19, 20, 21),
        'Self-rotation and its errors without noise',
        f'The three models cannot be distinguished in Fig. 18. Errors: classic about '
        f'{PRINTED_CLASSIC:g}, SimMechanics about {PRINTED_MULTI_BODY:g} deg, both amplified near '
        f'the singularity; improved about {PRINTED_IMPROVED:.0e} deg, not amplified.',
        f'Largest errors: classic {_size(run.error("classic"))}, multi-body '
        f'{_size(run.error("multi-body"))}, improved {_size(run.error("improved"))}, `estimate` '
        f'{_size(run.error("estimate"))} deg. The first two grow near the singularity, the '
        'last two do not.',
        verdict(improved < 1e-12 and worst > PRINTED_MULTI_BODY, Verdict.PARTLY),
        'The order and the shape agree; the sizes of the first two are those of the solver, not '
        f'of the mechanism. At the singularity a platform that is off by {PRINTED_CLASSIC:g} deg '
        f'leaves the loops open by {opened[0]:.1e} only, one that is off by '
        f'{PRINTED_MULTI_BODY:g} deg by {opened[1]:.1e}: a solver with such a tolerance '
        "would make the paper's errors; the print does not name its tolerance. Here both models "
        'are solved to rounding.',
        'fig18_21.png',
        table(HEADER, [_statistics(run, name) for name in MODELS]),
    )


def _second() -> Entry:
    return Entry(
        (22,),
        'Second scenario',
        'The flowchart of Fig. 16 with random errors on the active joint angles.',
        f'The same, with σ = {degrees(SIGMA):g} deg.',
        Verdict.AGREES,
        'The text puts the noise on the active joints only: th3A is exact. The last table of this '
        'scenario puts it on th3A, too.',
        details=_flow('noise on th1A, th1B, th1C'),
    )


def _noisy(out: Path, run: Run, every: Run) -> Entry:
    _draw(
        run,
        'noise on the active angles',
        False,
        (23, 24, 25, 26),
        {'improved': PRINTED_NOISY},
        out / 'fig23_26.png',
    )
    improved = np.abs(run.error('improved'))
    rms = float(np.sqrt(np.mean(improved**2)))
    within = 100.0 * float(np.mean(improved < PRINTED_NOISY))
    classic = run.error('classic')
    worst = float(np.nanmax(np.abs(classic)))
    same = float(np.nanmax(np.abs(classic - run.error('multi-body'))))
    details = table(HEADER, [_statistics(run, name) for name in MODELS])
    details += '\n\nThe same with noise on th3A, too, as a rig has it:\n\n'
    details += table(HEADER, [_statistics(every, name) for name in MODELS])
    return Entry(
        (23, 24, 25, 26),
        'Self-rotation and its errors with noise on the active angles',
        'Classic and SimMechanics: more than 1 deg near the singularity. Improved: less than '
        f'{PRINTED_NOISY:g} deg, without amplification.',
        f'Classic: up to {worst:.2g} deg, and no answer at all in {int(np.isnan(classic).sum())} '
        f'of {len(classic)} samples. Multi-body: up to {_size(run.error("multi-body"))} deg, and '
        f'not assembled in {int(np.isnan(run.error("multi-body")).sum())}. '
        f'Improved: rms {rms:.4f}, largest {improved.max():.4f} deg, without amplification.',
        verdict(worst > 1.0 and improved.max() < PRINTED_NOISY, Verdict.PARTLY),
        f'Classic and multi-body model are one curve, to {same:.0e} deg: they solve the same '
        f"equations. {within:.0f} % of the improved model's errors are below "
        f'{PRINTED_NOISY:g} deg. Normal noise of {degrees(SIGMA):g} deg leaves them a standard '
        f'deviation of {rms:.4f} deg, so that a bound of {PRINTED_NOISY:g} deg holds for most '
        'samples, not for all. `estimate` assumes the same noise on th3A as on the others, so '
        'that it does not profit from the exact th3A.',
        'fig23_26.png',
        details,
    )


def _tracking(R: np.ndarray, noise: np.ndarray) -> Entry:
    th1 = inverse(R).theta1
    phi = _phi(R)
    rows = []
    for name, angles in (
        ('no noise', th1),
        (f'noise of {degrees(SIGMA):g} deg', th1 + noise[:, :3]),
    ):
        last, wrong, silent = R[0], 0, 0
        for row in range(len(R)):
            try:
                last = track_mode(angles[row], last, G).rotation
            except SpmError:
                silent += 1
                continue
            wrong += abs(_phi(last[None])[0] - phi[row]) > NEAR
        rows.append((name, f'{100.0 * wrong / len(R):.1f} %', f'{100.0 * silent / len(R):.1f} %'))
    return Entry(
        (19, 24),
        'What a controller without the fourth sensor would see',
        'When the device leaves the singular configuration, the classic FKM cannot ensure the '
        'selection of the suitable solution (section 2.2).',
        'In the figures above the imposed pose selects the mode of the classic model, and of the '
        'multi-body model with noise, which begins each search there. A classic model that '
        'follows the mode nearest to its last one is in the wrong mode for the part of the time '
        'in the table.',
        Verdict.AGREES,
        details=table(
            (
                'classic FKM, mode nearest to the last',
                f'off by more than {NEAR:g} deg',
                'no answer',
            ),
            rows,
        ),
    )
