// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// The panel of each device: its sentence, chips, figures, plots, log, and its last two minutes.
const panel = (() => {
    const devices = new Map();
    const then = add(document.body, 'div', 'spm-then');
    then.setAttribute('role', 'status');

    function device(name) {
        if (devices.has(name)) return devices.get(name);
        const [root, lower] = ['div', 'div'].map((tag) => document.createElement(tag));
        const made = {root, lower, rows: [], plots: [], samples: [], events: [], end: null,
            colours: new Map(), story: null};
        made.note = add(root, 'div', 'spm-note');
        made.note.setAttribute('role', 'status');
        made.words = add(made.note, 'span');
        made.progress = add(made.note, 'div', 'spm-progress');
        made.progress.setAttribute('role', 'progressbar');
        made.done = add(made.progress, 'div');
        made.chips = add(root, 'ul', 'spm-chips');
        label(made.chips, 'encoders');
        made.calibration = add(root, 'div');
        made.upper = add(root, 'div');
        made.table = add(lower, 'table', 'spm-table');
        label(made.table, 'figures');
        addTime(made, lower);
        made.graphs = add(lower, 'div');
        made.strip = add(lower, 'canvas', 'spm-plot');
        made.strip.setAttribute('role', 'img');
        label(made.strip, 'states of the last 30 s');
        made.strip.onmousemove = (event) => put(made.event, plots.wordsAt(made, event.offsetX));
        made.event = add(lower, 'div', 'spm-event');
        addLog(made, lower);
        devices.set(name, made);
        return made;
    }

    function addTime(made, parent) {
        const time = add(parent, 'div');
        made.pause = button(time, 'pause',
            () => hold(made, made.end === null ? plots.newest(made) : null));
        made.scrub = add(time, 'input');
        Object.assign(made.scrub, {type: 'range', min: plots.SHOWN - plots.SPAN, max: 0,
            step: 0.5, value: 0, title: 'over the last two minutes'});
        label(made.scrub, 'time before the pause, s');
        made.scrub.oninput = () => {
            if (made.end === null) hold(made, plots.newest(made));
            hold(made, made.from + Number(made.scrub.value));
        };
    }

    function addLog(made, parent) {
        const head = add(parent, 'div', 'spm-head');
        add(head, 'b', '', 'log');
        button(head, 'copy', () => copy([...made.log.children].map((line) => line.textContent)));
        made.log = add(parent, 'div', 'spm-log');
        made.log.setAttribute('role', 'log');
        made.log.tabIndex = 0;
        label(made.log, 'log of events');
    }

    function copy(lines) {
        const area = add(document.body, 'textarea');
        area.value = lines.join('\n');
        area.select();
        // The clipboard of today needs https; this works at any address.
        document.execCommand('copy');
        area.remove();
    }

    // Plots and picture stand still at a time, or (null) show the present.
    function hold(made, end) {
        if (made.end === null) made.from = end;
        made.end = end;
        put(made.pause, end === null ? 'pause' : 'go on');
        showPause();
        if (end === null) {
            made.scrub.value = 0;
            past.release();
        } else past.show(made.samples.filter(({t}) => t <= end).at(-1)?.picture);
        plots.draw(made);
    }

    // A paused picture says so: it is not the present one.
    function showPause() {
        const made = [...devices.values()].find(({end}) => end !== null);
        document.body.classList.toggle('spm-paused', made !== undefined);
        if (made) put(then, `paused: the picture of ${(plots.newest(made) - made.end).toFixed(0)} s ago`);
    }

    function fill(bar, share, colour) {
        bar.style.width = `${100 * Math.min(Math.max(share, 0), 1)}%`;
        bar.style.background = colour;
    }

    function showNote(made, {text, warns, story}) {
        put(made.words, text);
        made.note.style.borderColor = warns ? '#b42318' : '#8888';
        made.progress.style.visibility = story ? 'visible' : 'hidden';
        if (story) {
            fill(made.done, story.step / story.steps, 'currentColor');
            const attributes = {'aria-valuenow': story.step, 'aria-valuemax': story.steps,
                'aria-label': `${story.name}: step ${story.step} of ${story.steps}`};
            for (const [key, value] of Object.entries(attributes)) {
                made.progress.setAttribute(key, value);
            }
        }
    }

    // A story turns the camera to where it is seen best, once.
    function followStory(made, {note: {story}, ghostView}) {
        if (story && story.number !== made.story) {
            if (story.view === 'ghost') camera.lookAt(ghostView); else camera.look(story.view);
        } else if (!story && made.story !== null) camera.look('front');
        made.story = story?.number ?? null;
    }

    function showRows(made, rows) {
        while (made.table.children.length > rows.length) {
            made.table.lastChild.remove();
            made.rows.pop();
        }
        rows.forEach(({name, text, share, colour}, index) => {
            const row = made.table.children[index] ?? add(made.table, 'tr');
            const cells = made.rows[index] ??= (() => {
                const head = add(row, 'th');
                head.scope = 'row';
                const cell = add(row, 'td');
                return {head, value: add(cell, 'span'), cell, bar: null};
            })();
            put(cells.head, name);
            put(cells.value, text);
            cells.cell.title = text;
            if (share === null) {
                cells.bar?.parentElement.remove();
                cells.bar = null;
                return;
            }
            cells.bar ??= add(add(cells.cell, 'div', 'spm-bar'), 'div');
            fill(cells.bar, share, colour);
        });
    }

    function showChips(made, chips) {
        while (made.chips.children.length > chips.length) made.chips.lastChild.remove();
        chips.forEach(({text, title, colour}, index) => {
            const chip = made.chips.children[index] ?? add(made.chips, 'li', 'spm-chip');
            chip.tabIndex = 0;
            put(chip, text);
            label(chip, title);
            chip.title = title;
            chip.style.background = colour;
        });
    }

    function showCalibration(made, found) {
        made.calibration.replaceChildren();
        if (!found) return;
        add(made.calibration, 'b', '', found.text);
        for (const [name, share, colour] of found.covered) {
            const line = add(made.calibration, 'div', '', `${name} ${Math.round(100 * share)} %`);
            fill(add(add(line, 'div', 'spm-bar'), 'div'), share, colour);
        }
    }

    function place(made, name) {
        for (const [part, id] of [[made.root, `spm-${name}`], [made.lower, `spm-${name}-lower`]]) {
            const host = document.getElementById(id);
            if (host && part.parentElement !== host) host.replaceChildren(part);
        }
    }

    // viser's sliders and fields have their names beside them, and no others.
    function nameControls() {
        for (const control of document.querySelectorAll(
            '.mantine-Slider-thumb, .mantine-NumberInput-input, .mantine-Select-input')) {
            const name = nameBeside(control);
            if (name) label(control, name);
        }
        const settings = document.querySelector('.mantine-ActionIcon-root:not([aria-label])');
        if (settings) label(settings, 'settings of the picture');
    }
    function nameBeside(control) {
        for (let part = control; part.parentElement; part = part.parentElement) {
            const before = part.previousElementSibling;
            if (!part.parentElement.classList.contains('mantine-Flex-root') || !before) continue;
            if (!before.querySelector('input, [role=slider]')) return before.textContent;
        }
        return '';
    }

    return {
        show: ({name, content, banner}) => {
            const made = device(name);
            made.colours.set(banner.light, banner.colour);
            place(made, name);
            showNote(made, content.note);
            followStory(made, content);
            showRows(made, content.rows);
            showChips(made, content.chips);
            showCalibration(made, content.calibration);
            plots.arrange(made, content.plots);
            plots.record(made, content.sample);
            if (made.end === null) plots.draw(made);
            showPause();
            nameControls();
        },
        // Devices that are no longer there.
        keep: (names) => {
            for (const name of devices.keys()) if (!names.has(name)) devices.delete(name);
        },
        draw: () => devices.forEach(plots.draw),
        first: () => devices.values().next().value,
    };
})();
