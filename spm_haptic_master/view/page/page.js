// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// What is on the page beside the picture, of the messages of `Page`: it only shows, sends nothing,
// and what a user operates here (pause, views, save, dark) reaches nobody else.
window.spm ??= ((setup) => {
    // Times kept, shown, and bridged by a line (s); height and left edge of a plot (pixels).
    const SPAN = 120, SHOWN = 30, GAP = 1.6, HEIGHT = 74, LEFT = 34;
    const add = (parent, tag, name = '', text = '') => {
        const element = document.createElement(tag);
        element.className = name;
        element.textContent = text;
        parent.append(element);
        return element;
    };
    const put = (element, text) => {
        if (element.textContent !== text) element.textContent = text;
    };
    add(document.head, 'style', '', setup.css);
    const banners = add(document.body, 'div', 'spm-banners');
    const lost = add(document.body, 'div', 'spm-lost', setup.lost);
    const tools = add(document.body, 'div', 'spm-tools');
    const button = (parent, text, act) => {
        const made = add(parent, 'button', '', text);
        made.onclick = act;
        return made;
    };

    // Tools: the colours of the dome, views, a file, and a dark page.
    add(tools, 'div', '', 'dome: dexterity of three encoders');
    add(tools, 'div', 'spm-dome').style.background = `linear-gradient(90deg,${setup.dome.colours})`;
    const scale = add(tools, 'div', 'spm-scale');
    for (const text of setup.dome.words) add(scale, 'span', '', text);
    // From the scene's frame to that of the renderer, by the turn of the scene's root.
    const turned = ([px, py, pz]) => {
        const [w, x, y, z] = window.__viserSceneTree.getState()[''].wxyz;
        const [tx, ty, tz] = [2 * (y * pz - z * py), 2 * (z * px - x * pz), 2 * (x * py - y * px)];
        return [px + w * tx + y * tz - z * ty, py + w * ty + z * tx - x * tz,
            pz + w * tz + x * ty - y * tx];
    };
    let views = setup.views, looked = false;
    // The camera's angle is from top to bottom: a page that is higher than wide backs off.
    function look(name, smoothly) {
        const control = window.__viserMutable?.cameraControl, [place, target] = views[name];
        const {clientWidth, clientHeight} = window.__viserMutable?.canvas ?? {};
        if (!control || !clientWidth) return false;
        const back = Math.min(Math.max(1, 0.8 * clientHeight / clientWidth), 3);
        // The panel is before its lower third then.
        const aim = [target[0], target[1], target[2] - 0.45 * (back - 1)];
        const away = place.map((each, k) => aim[k] + back * (each - target[k]));
        control.setLookAt(...turned(away), ...turned(aim), smoothly);
        return true;
    }
    for (const name of Object.keys(setup.views)) button(tools, name, () => look(name, true));
    add(tools, 'br');
    button(tools, 'save picture', save);
    button(tools, 'dark', () => {
        const address = new URL(location), dark = !isDark();
        document.documentElement.dataset.mantineColorScheme = dark ? 'dark' : 'light';
        address.searchParams.delete('darkMode');
        if (dark) address.searchParams.set('darkMode', '');
        history.replaceState(null, '', address);
        devices.forEach(draw);
    });
    const isDark = () => document.documentElement.dataset.mantineColorScheme === 'dark';

    // A device: what is shown of it, and its last two minutes.
    const devices = new Map();
    function device(name) {
        if (devices.has(name)) return devices.get(name);
        const [root, lower] = ['div', 'div'].map((tag) => document.createElement(tag));
        const made = {root, lower, rows: [], plots: [], samples: [], events: [], end: null};
        made.note = add(root, 'div', 'spm-note');
        made.chips = add(root, 'div', 'spm-chips');
        made.table = add(root, 'table', 'spm-table');
        made.calibration = add(lower, 'div');
        const time = add(lower, 'div');
        made.pause = button(time, 'pause', () => hold(made, made.end === null ? newest(made) : null));
        made.scrub = add(time, 'input');
        Object.assign(made.scrub, {type: 'range', min: SHOWN - SPAN, max: 0, step: 0.5, value: 0,
            title: 'over the last two minutes'});
        made.scrub.oninput = () => {
            if (made.end === null) hold(made, newest(made));
            hold(made, made.from + Number(made.scrub.value));
        };
        made.graphs = add(lower, 'div');
        made.strip = add(lower, 'canvas', 'spm-plot');
        made.strip.onmousemove = (event) => point(made, event.offsetX);
        made.event = add(lower, 'div', 'spm-event');
        made.log = add(lower, 'div', 'spm-log');
        const legend = add(lower, 'details');
        add(legend, 'summary', '', 'legend');
        for (const line of setup.legend) add(legend, 'div', '', line);
        devices.set(name, made);
        return made;
    }
    const newest = (made) => made.samples.at(-1)?.t ?? 0;
    function hold(made, end) {
        if (made.end === null) made.from = end;
        made.end = end;
        made.pause.textContent = end === null ? 'pause' : 'go on';
        if (end === null) made.scrub.value = 0;
        draw(made);
    }

    function fill(bar, share, colour) {
        bar.style.width = `${100 * Math.min(Math.max(share, 0), 1)}%`;
        bar.style.background = colour;
    }
    function showRows(made, rows) {
        rows.forEach(([name, text, share, colour], index) => {
            const row = made.table.children[index] ?? add(made.table, 'tr');
            const [label, value, bar] = made.rows[index] ??= (() => {
                const [left, right] = [add(row, 'td'), add(row, 'td')];
                return [add(left, 'span'), add(right, 'span'),
                    share === undefined ? null : add(add(right, 'div', 'spm-bar'), 'div')];
            })();
            put(label, name);
            put(value, text);
            value.parentElement.title = text;
            if (bar) fill(bar, share, colour);
        });
    }

    function showChips(made, chips) {
        while (made.chips.children.length > chips.length) made.chips.lastChild.remove();
        chips.forEach(([text, title, colour], index) => {
            const chip = made.chips.children[index] ?? add(made.chips, 'span', 'spm-chip');
            put(chip, text);
            chip.title = title;
            chip.style.background = colour;
        });
    }

    function showCalibration(made, found) {
        made.calibration.replaceChildren();
        if (!found) return;
        add(made.calibration, 'b', '', found.text);
        for (const [name, share, colour] of found.covered) {
            const line = add(made.calibration, 'div', '', name);
            fill(add(add(line, 'div', 'spm-bar'), 'div'), share, colour);
        }
    }

    // Plots.
    function record(made, {t, state, colour, values, happened}) {
        if (made.samples.length && t <= newest(made)) return;
        const before = made.samples.at(-1);
        made.samples.push({t, state, colour, values});
        while (made.samples[0].t < t - SPAN) made.samples.shift();
        while (made.events.length && made.events[0].t < t - SPAN) made.events.shift();
        for (const text of [...(before?.state === state ? [] : [state]), ...happened]) {
            made.events.push({t, text});
            const time = new Date().toTimeString().slice(0, 8);
            made.log.prepend(add(made.log, 'div', '', `${time}  ${text}`));
            if (made.log.children.length > 100) made.log.lastChild.remove();
        }
    }
    const fitted = (canvas, height) => {
        const ratio = devicePixelRatio, width = canvas.clientWidth;
        canvas.style.height = `${height}px`;
        canvas.width = width * ratio;
        canvas.height = height * ratio;
        const pen = canvas.getContext('2d');
        pen.scale(ratio, ratio);
        return [pen, width];
    };
    const endOf = (made) => made.end ?? newest(made);
    const acrossOf = (end, width) => (t) => LEFT + (width - LEFT - 2) * (t - end + SHOWN) / SHOWN;
    function draw(made) {
        if (!made.lower.isConnected || !made.lower.clientWidth) return;
        const end = endOf(made), ink = isDark() ? '#ccc' : '#444';
        const within = ({t}) => t >= end - SHOWN && t <= end, seen = made.samples.filter(within);
        for (const {canvas, title, spec} of made.plots) {
            const [pen, width] = fitted(canvas, HEIGHT);
            const rows = seen.map((sample) => sample.values[spec.key] ?? []);
            const numbers = [...rows.flat(), ...spec.limits.map(([value]) => value)].filter(
                Number.isFinite);
            let low = Math.min(...(spec.zero ? [0] : []), ...numbers);
            let high = Math.max(...numbers);
            if (!(high > low)) [low, high] = [(high || 0) - 1, (high || 0) + 1];
            const x = acrossOf(end, width);
            const y = (value) => HEIGHT - 4 - (HEIGHT - 10) * (value - low) / (high - low);
            pen.font = '10px sans-serif';
            pen.fillStyle = ink;
            for (const value of [low, high]) {
                pen.fillText(Number(value.toPrecision(3)), 0, Math.max(y(value), 8));
            }
            pen.strokeStyle = '#8886';
            pen.strokeRect(LEFT, 2, width - LEFT - 2, HEIGHT - 4);
            for (const [value, colour] of spec.limits) {
                pen.strokeStyle = colour;
                pen.setLineDash([5, 3]);
                pen.beginPath();
                pen.moveTo(LEFT, y(value));
                pen.lineTo(width - 2, y(value));
                pen.stroke();
            }
            spec.series.forEach(([, colour, dash], index) => {
                pen.strokeStyle = colour;
                pen.lineWidth = 1.4;
                pen.setLineDash(dash ? [3, 2] : []);
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
            });
            const final = rows.at(-1) ?? [];
            spec.series.forEach(([name], index) => put(title.children[index + 1],
                `${name} ${Number.isFinite(final[index])
                    ? Number(final[index].toPrecision(3)) : '–'}`));
        }
        const [pen, width] = fitted(made.strip, 16);
        const x = acrossOf(end, width);
        seen.forEach(({t, colour}, k) => {
            const next = Math.min(seen[k + 1]?.t ?? t, t + GAP);
            pen.fillStyle = colour;
            pen.fillRect(x(t), 0, Math.max(x(next) - x(t) + 0.5, 1), 12);
        });
        pen.fillStyle = ink;
        for (const {t} of made.events.filter(within)) pen.fillRect(x(t), 0, 2, 16);
    }
    function point(made, at) {
        const end = endOf(made), width = made.strip.clientWidth;
        const t = end - SHOWN + SHOWN * (at - LEFT) / (width - LEFT - 2);
        const event = made.events.filter((each) => Math.abs(each.t - t) < SHOWN / 60).at(-1);
        const sample = made.samples.filter((each) => each.t <= t && t - each.t < GAP).at(-1);
        put(made.event, event || sample
            ? `${(t - end).toFixed(1)} s: ${event?.text ?? sample.state}` : '');
    }
    function showPlots(made, specs) {
        specs.forEach((spec, index) => {
            const plot = made.plots[index] ??= {
                title: add(made.graphs, 'div', 'spm-title'),
                canvas: add(made.graphs, 'canvas', 'spm-plot')};
            if (plot.title.children.length !== spec.series.length + 1) {
                plot.title.replaceChildren();
                add(plot.title, 'b', '', spec.title);
                for (const [, colour] of spec.series) add(plot.title, 'span').style.color = colour;
            }
            plot.spec = spec;
        });
    }

    // The picture and the plots of the first device as one file.
    function save() {
        const canvas = window.__viserMutable.canvas, [made] = devices.values();
        // The renderer draws at once: its picture is lost at the end of the task.
        window.__viserMutable.syncCanvasSize(canvas.clientWidth, canvas.clientHeight);
        const all = document.createElement('canvas'), parts = [...made.graphs.children, made.strip];
        const plots = parts.filter((part) => part.tagName === 'CANVAS' && part.width);
        const wide = Math.max(0, ...plots.map((part) => part.width));
        all.width = canvas.width + wide;
        all.height = Math.max(canvas.height, plots.reduce((sum, part) => sum + part.height + 18, 0));
        const pen = all.getContext('2d');
        pen.fillStyle = isDark() ? '#141414' : '#fff';
        pen.fillRect(0, 0, all.width, all.height);
        pen.drawImage(canvas, 0, 0);
        pen.font = '12px sans-serif';
        let down = 0;
        for (const part of plots) {
            pen.fillStyle = isDark() ? '#ccc' : '#444';
            pen.fillText(part.previousElementSibling?.innerText ?? '', canvas.width, down + 13);
            pen.drawImage(part, canvas.width, down + 18);
            down += part.height + 18;
        }
        pen.fillText(`${banners.innerText}  ${new Date().toISOString()}`, 8, all.height - 8);
        const link = document.createElement('a');
        link.download = 'haptic_master.png';
        link.href = all.toDataURL('image/png');
        link.click();
    }

    let timer, shown;
    return {save, show: (news) => {
        const heads = JSON.stringify(news.devices.map(({banner}) => banner));
        if (heads !== shown) {
            shown = heads;
            banners.replaceChildren();
            for (const {banner: [text, colour, alive]} of news.devices) {
                const banner = add(banners, 'div', 'spm-banner', text);
                banner.style.background = colour;
                banner.dataset.alive = Number(alive);
            }
        }
        clearTimeout(timer);
        lost.style.visibility = 'hidden';
        timer = setTimeout(() => { lost.style.visibility = 'visible'; }, setup.timeout);
        views = news.views;
        looked ||= innerHeight < innerWidth || look('front', false);
        for (const {name, content} of news.devices) if (content) {
            const made = device(name);
            for (const [part, id] of [[made.root, `spm-${name}`], [made.lower, `spm-${name}-lower`]]) {
                const host = document.getElementById(id);
                if (host && part.parentElement !== host) host.replaceChildren(part);
            }
            put(made.note, content.note);
            made.note.style.borderColor = content.warns ? '#b42318' : '#8888';
            showRows(made, content.rows);
            showChips(made, content.chips);
            showCalibration(made, content.calibration);
            showPlots(made, content.plots);
            record(made, content.sample);
            if (made.end === null) draw(made);
        }
    }};
})(SETUP);
