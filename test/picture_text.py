# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pictures in words, for comparison with recorded ones: labels, colours and widths, no data."""

from matplotlib.colors import to_hex


def in_words(figure):
    """Return the axes of a picture, a paragraph each, and its legend."""
    texts = [f'heights {figure.axes[0].get_gridspec().get_height_ratios()}']
    for axes in figure.axes:
        title = axes.get_title() and f'{axes.get_title()} ({axes.title.get_fontsize()}), '
        texts.append(
            f'{title}{axes.get_xlabel()}; {axes.get_ylabel()}; grid below {axes.get_axisbelow()}'
        )
        texts += [
            f'  line {line.get_label()} {to_hex(line.get_color())} '
            + (
                f'{line.get_linestyle()} {line.get_linewidth()}'
                if line.get_linestyle() != 'None'
                else f'{line.get_marker()} {line.get_markersize()}'
            )
            for line in axes.lines
        ]
        texts += sorted(
            {
                f'  area {to_hex(each.get_facecolor(), keep_alpha=True)} {each.get_linewidth()}'
                for each in axes.patches
            }
        )
    texts += [
        f'legend {each.get_text()} {each.get_fontsize()}'
        for legend in (*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes)))
        for each in legend.texts
    ]
    return '\n'.join(texts) + '\n'
