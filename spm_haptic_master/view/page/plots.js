// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// Plots of the last two minutes, and the strip of states below them.
const plots = (() => {
    // Times kept, shown, and bridged by a line (s); height, left edge, room for the names of limits
    // on the right, lower edge (pixels).
    const SPAN = 120, SHOWN = 30, GAP = 1.6, HEIGHT = 70, LEFT = 34, RIGHT = 44, AXIS = 13;
    // Distance of two names of limits (pixels).
    const LINE = 10;
    const STRIP = 14;
    const HATCH = {GREEN: 0, AMBER: 6, RED: 3, GREY: 0};

    const newest = (made) => made.samples.at(-1)?.t ?? 0;
    const endOf = (made) => made.end ?? newest(made);
    const acrossOf = (end, width) => (t) => LEFT + (width - LEFT - RIGHT) * (t - end + SHOWN) / SHOWN;
    const inkOfPage = () => isDark() ? '#d5d5d5' : '#3a3a3a';

    function record(made, {t, state, light, values, happened}) {
        if (made.samples.length && t <= newest(made)) return;
        const before = made.samples.at(-1);
        made.samples.push({t, state, light, values, picture: past.snapshot()});
        while (made.samples[0].t < t - SPAN) made.samples.shift();
        while (made.events.length && made.events[0].t < t - SPAN) made.events.shift();
        for (const text of [...(before?.state === state ? [] : [state]), ...happened]) {
            made.events.push({t, text});
            const time = new Date().toTimeString().slice(0, 8);
            made.log.prepend(add(made.log, 'div', '', `${time}  ${text}`));
            if (made.log.children.length > 200) made.log.lastChild.remove();
        }
    }

    // A canvas as wide as its place, and sharp.
    const fitted = (canvas, height) => {
        const ratio = devicePixelRatio, width = canvas.clientWidth;
        canvas.style.height = `${height}px`;
        canvas.width = width * ratio;
        canvas.height = height * ratio;
        const pen = canvas.getContext('2d');
        pen.scale(ratio, ratio);
        return [pen, width];
    };

    function rangeOf(spec, rows) {
        const numbers = [...rows.flat(), ...spec.limits.map(({value}) => value)].filter(
            Number.isFinite);
        const low = Math.min(...(spec.has_zero ? [0] : []), ...numbers);
        const high = Math.max(...numbers);
        return high > low ? [low, high] : [(high || 0) - 1, (high || 0) + 1];
    }

    function drawAxes(pen, width, [low, high], y, end) {
        pen.font = '10px sans-serif';
        pen.fillStyle = inkOfPage();
        for (const value of [low, high]) pen.fillText(rounded(value), 0, Math.max(y(value), 8));
        pen.strokeStyle = '#8888';
        pen.lineWidth = 1;
        pen.strokeRect(LEFT, 2, width - LEFT - RIGHT, HEIGHT - 4);
        const x = acrossOf(end, width);
        for (const back of [30, 20, 10, 0]) {
            const text = back ? `-${back} s` : 'now', at = x(end - back);
            pen.beginPath();
            pen.moveTo(at, HEIGHT - 6);
            pen.lineTo(at, HEIGHT - 2);
            pen.stroke();
            const wide = pen.measureText(text).width;
            pen.fillText(text, Math.min(at - wide / 2, width - wide), HEIGHT + AXIS - 3);
        }
    }

    // Each limit has its name on the right of the plot, beside its line: clear of curves and axes.
    function drawLimits(pen, width, limits, y) {
        let below = HEIGHT + LINE;
        for (const {value, name, ink} of [...limits].sort((one, other) => one.value - other.value)) {
            const right = width - RIGHT, middle = y(value);
            pen.strokeStyle = pen.fillStyle = inkOf(ink);
            pen.setLineDash([5, 3]);
            pen.beginPath();
            pen.moveTo(LEFT, middle);
            pen.lineTo(right, middle);
            pen.stroke();
            below = Math.min(middle + 4, below - LINE);
            pen.fillText(name, right + 4, below);
        }
        pen.setLineDash([]);
    }

    function drawSeries(pen, seen, rows, series, index, x, y) {
        pen.strokeStyle = inkOf(series.ink);
        pen.lineWidth = 1.6;
        pen.setLineDash(series.is_dashed ? [4, 3] : []);
        pen.beginPath();
        let last = -Infinity;
        seen.forEach(({t}, k) => {
            const value = rows[k][index];
            if (!Number.isFinite(value)) return;
            // Nothing is joined over a gap: what was there, nobody has seen.
            const joined = t - last <= GAP && Number.isFinite(rows[k - 1]?.[index]);
            if (joined) pen.lineTo(x(t), y(value)); else pen.moveTo(x(t), y(value));
            last = t;
        });
        pen.stroke();
        pen.setLineDash([]);
    }

    function drawPlot({canvas, title, spec}, seen, end) {
        const [pen, width] = fitted(canvas, HEIGHT + AXIS);
        const rows = seen.map((sample) => sample.values[spec.key] ?? []);
        const range = rangeOf(spec, rows), [low, high] = range;
        const x = acrossOf(end, width);
        const y = (value) => HEIGHT - 4 - (HEIGHT - 10) * (value - low) / (high - low);
        drawAxes(pen, width, range, y, end);
        drawLimits(pen, width, spec.limits, y);
        spec.series.forEach((series, index) => drawSeries(
            pen, seen, rows, series, index, x, y));
        const final = rows.at(-1) ?? [];
        const figures = spec.series.map(({name}, k) => `${name} ${rounded(final[k])}`.trim());
        figures.forEach((text, k) => put(title.children[k + 1].lastChild, text));
        label(canvas, `plot: ${spec.title}: ${figures.join(', ')}`);
    }

    // Colours of states with hatching: they are told apart without colours, too.
    function drawStrip(made, seen, end) {
        const [pen, width] = fitted(made.strip, STRIP + 4);
        const x = acrossOf(end, width);
        seen.forEach(({t, light}, k) => {
            const next = Math.min(seen[k + 1]?.t ?? t, t + GAP);
            const [from, to] = [x(t), Math.max(x(next) + 0.5, x(t) + 1)];
            pen.fillStyle = made.colours.get(light) ?? '#888';
            pen.fillRect(from, 0, to - from, STRIP);
            if (!HATCH[light]) return;
            pen.save();
            pen.beginPath();
            pen.rect(from, 0, to - from, STRIP);
            pen.clip();
            pen.strokeStyle = '#fff';
            pen.lineWidth = 1;
            pen.beginPath();
            for (let at = LEFT - STRIP; at < width; at += HATCH[light]) {
                pen.moveTo(at, STRIP);
                pen.lineTo(at + STRIP, 0);
            }
            pen.stroke();
            pen.restore();
        });
        pen.fillStyle = inkOfPage();
        for (const {t} of made.events.filter(({t}) => t >= end - SHOWN && t <= end)) {
            pen.fillRect(x(t), 0, 2, STRIP + 4);
        }
    }

    function draw(made) {
        if (!made.root.isConnected || !made.root.clientWidth) return;
        const end = endOf(made);
        const seen = made.samples.filter(({t}) => t >= end - SHOWN && t <= end);
        for (const plot of made.plots) if (plot.canvas.clientWidth) drawPlot(plot, seen, end);
        if (made.strip.clientWidth) drawStrip(made, seen, end);
    }

    // What was there at a place of the strip, in words.
    function wordsAt(made, at) {
        const end = endOf(made), width = made.strip.clientWidth;
        const t = end - SHOWN + SHOWN * (at - LEFT) / (width - LEFT - RIGHT);
        const event = made.events.filter((other) => Math.abs(other.t - t) < SHOWN / 60).at(-1);
        const sample = made.samples.filter((other) => other.t <= t && t - other.t < GAP).at(-1);
        return event || sample ? `${(t - end).toFixed(1)} s: ${event?.text ?? sample.state}` : '';
    }

    // The plots of a device: the first ones at the top of its panel.
    function arrange(made, specs) {
        specs.forEach((spec, index) => {
            const parent = spec.on_top ? made.upper : made.graphs;
            const plot = made.plots[index] ??= {
                title: add(parent, 'div', 'spm-title'), canvas: add(parent, 'canvas', 'spm-plot')};
            plot.canvas.setAttribute('role', 'img');
            if (plot.title.children.length !== spec.series.length + 1) {
                plot.title.replaceChildren();
                // Names that fill more than a line.
                plot.title.classList.toggle('spm-many', spec.series.length > 2);
                add(plot.title, 'b', '', spec.title);
                for (const _ of spec.series) {
                    const part = add(plot.title, 'span');
                    add(part, 'i');
                    add(part, 'span');
                }
            }
            spec.series.forEach(({ink, is_dashed}, k) => {
                const line = plot.title.children[k + 1].firstChild;
                line.style.borderTop = `2px ${is_dashed ? 'dashed' : 'solid'} ${inkOf(ink)}`;
            });
            plot.spec = spec;
        });
    }

    // Title of a plot and the names of its quantities, each behind a piece of its line; narrower
    // where the width asks for it.
    function writeTitle(pen, {title, spec}, left, top, width) {
        const KEY = 20, BLANK = 8;
        const texts = [...title.children].map(({textContent}) => textContent.trim());
        const lengths = texts.map((text, k) => pen.measureText(text).width + BLANK + (k ? KEY : 0));
        const length = lengths.reduce((sum, part) => sum + part, 0);
        pen.save();
        pen.translate(left, top);
        pen.scale(Math.min(1, width / length), 1);
        texts.forEach((text, k) => {
            if (k) drawKey(pen, spec.series[k - 1]);
            pen.fillText(text, k ? KEY : 0, 0);
            pen.translate(lengths[k], 0);
        });
        pen.restore();
    }

    function drawKey(pen, {ink, is_dashed}) {
        pen.strokeStyle = inkOf(ink);
        pen.lineWidth = 2;
        pen.setLineDash(is_dashed ? [4, 3] : []);
        pen.beginPath();
        pen.moveTo(0, -4);
        pen.lineTo(16, -4);
        pen.stroke();
    }

    // The picture and the plots of a device as one file.
    function save(made, words) {
        const canvas = window.__viserMutable.canvas;
        // The renderer draws at once: its picture is lost at the end of the task.
        window.__viserMutable.syncCanvasSize(canvas.clientWidth, canvas.clientHeight);
        const drawn = (made?.plots ?? []).filter(({canvas: part}) => part.width);
        const all = document.createElement('canvas');
        const wide = Math.max(0, ...drawn.map(({canvas: part}) => part.width));
        const high = drawn.reduce((sum, {canvas: part}) => sum + part.height + 18, 0);
        all.width = canvas.width + wide;
        all.height = Math.max(canvas.height, high);
        const pen = all.getContext('2d');
        pen.fillStyle = isDark() ? '#141414' : '#fff';
        pen.fillRect(0, 0, all.width, all.height);
        pen.drawImage(canvas, 0, 0);
        pen.fillStyle = inkOfPage();
        pen.font = '12px sans-serif';
        let down = 0;
        for (const plot of drawn) {
            const part = plot.canvas;
            writeTitle(pen, plot, canvas.width, down + 13, part.width);
            pen.drawImage(part, canvas.width, down + 18);
            down += part.height + 18;
        }
        pen.fillText(`${words}   ${new Date().toISOString()}`, 8, all.height - 8);
        const link = document.createElement('a');
        link.download = 'haptic_master.png';
        link.href = all.toDataURL('image/png');
        link.click();
    }

    return {SPAN, SHOWN, newest, endOf, record, draw, wordsAt, arrange, save};
})();
