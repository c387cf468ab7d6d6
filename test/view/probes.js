// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// What the tests in a browser ask the page for, and do to it.

window.probes = (() => {
    const first = selector => document.querySelector(selector);
    const all = selector => [...document.querySelectorAll(selector)];
    const place = element => element.getBoundingClientRect();
    // Whether an element is in front at each of some points.
    const inFront = (element, points) =>
        points.every(([x, y]) => document.elementFromPoint(x, y) == element);
    const button = text => all("button").find(e => e.innerText.trim() == text);
    return {
        button,
        hasKnobs: () => Boolean(button("move by itself")),
        // What collapses the panel: the arrow at its top; on a phone, its title.
        arrow: () => first("[aria-label='Collapse panel area']"),
        title: () => all("div").filter(e => e.innerText?.trim() == "haptic master").at(-1),
        panel: () => place(first('.mantine-Paper-root[style*="max-height: 60%"]')),
        log: () => first(".spm-log").innerText,
        chips: () => Object.fromEntries(all(".spm-chip").map(e => [e.innerText, e.title])),
        // Whether the first chip of the panel is on the page.
        hasChip: () => {
            const b = first(".spm-chip")?.getBoundingClientRect();
            return Boolean(b && b.width && b.left >= 0 && b.right <= innerWidth
                && b.top < innerHeight);
        },
        // Value of a row of figures.
        row: name => all(".spm-table tr").find(e => e.cells[0].innerText == name)
            .cells[1].innerText,
        // The pixels of the first plot, and the number of plots.
        plot: () => first(".spm-plot").toDataURL(),
        plots: () => all(".spm-plot").length,
        scrub: seconds => {
            const slider = first(".spm-device input[type=range]");
            slider.value = seconds;
            slider.oninput();
        },
        // Where every row, chip, knob and plot is in its panel: name, left, top.
        places: () => {
            const panel = place(first(".spm-device"));
            return all(".spm-table tr, .spm-chip, .spm-plot, .mantine-Button-root, "
                + ".mantine-Slider-root").map(e => [e.className,
                Math.round(place(e).left - panel.left), Math.round(place(e).top - panel.top)])
                .filter(([, left]) => left > -30);
        },
        // Number of parts that reach under the scrollbar or out of the page.
        hidden: () => all(".spm-table, .spm-note, .spm-plot, .spm-log").filter(
            e => place(e).right > innerWidth - 8).length,
        // Titles of plots with a name that is cut.
        cutTitles: () => all(".spm-title").filter(e => e.scrollWidth > e.clientWidth + 1
            || e.scrollHeight > e.clientHeight + 1).map(e => e.innerText),
        // The banner's text, where all of it is on the page and nothing is before it.
        banner: () => {
            const e = first(".spm-banner");
            if (!e) return "";
            const b = place(e);
            return inFront(e, [0.02, 0.5, 0.98].map(
                part => [b.x + part * b.width, b.y + 0.5 * b.height]))
                && b.left >= 0 && b.right <= innerWidth && b.top >= 0 && b.width >= 60
                && b.height < 80 ? e.innerText : "";
        },
        // Whether the page is covered, all of it and above all else.
        isCovered: () => {
            const e = first(".spm-lost");
            if (!e) return false;
            const right = innerWidth - 1, bottom = innerHeight - 1;
            e.style.pointerEvents = "auto";
            const front = inFront(e, [
                [0, 0], [right, 0], [right / 2, bottom / 2], [0, bottom], [right, bottom]]);
            e.style.pointerEvents = "none";
            return front && getComputedStyle(e).visibility == "visible";
        },
        // A notice as a browser without a GPU has it, over all of the page.
        notice: () => {
            const notice = document.createElement("div");
            notice.style = "width: 100vw; height: 100vh; pointer-events: auto";
            first(".mantine-Notifications-root").append(notice);
        },
        // Keep the banner's latest text and since when it is there, by a clock of the page (ms)
        // that stands still while the page gets no time of the processor.
        watch: () => {
            window.clock = 0;
            window.seen = [0, ""];
            let before = Date.now();
            setInterval(() => {
                const now = Date.now(), text = first(".spm-banner")?.innerText ?? "";
                window.clock += Math.min(now - before, 50);
                before = now;
                if (text != window.seen[1]) window.seen = [window.clock, text];
            }, 10);
        },
        // Of the plot of the joint angles: the widest part of its width (0 .. 1) without the
        // first quantity, between two parts with it.
        widestGap: () => {
            const title = all(".spm-title").find(e => e.innerText.startsWith("joint angles"));
            const canvas = title?.nextElementSibling, colour = [31, 119, 180];
            if (!canvas?.width) return 1;
            const {width, height} = canvas;
            const data = canvas.getContext("2d").getImageData(0, 0, width, height).data;
            const columns = [...Array(width).keys()].filter(
                x => [...Array(height).keys()].some(y => {
                    const k = 4 * (y * width + x);
                    return data[k + 3] > 128
                        && colour.every((part, c) => Math.abs(data[k + c] - part) < 40);
                }));
            const gaps = columns.slice(1).map((x, index) => x - columns[index]);
            return gaps.length ? Math.max(...gaps) / width : 1;
        },
        // What a screen reader has of the page.
        names: () => ({
            sliders: all(".mantine-Slider-thumb").map(e => e.getAttribute("aria-label")),
            chips: all(".spm-chip").filter(e => e.tabIndex == 0)
                .map(e => e.getAttribute("aria-label")),
            joints: ["th1A (joint_1a)", "th1B (joint_1b)", "th1C (joint_1c)", "th3A (joint_3a)"],
            plots: all("canvas.spm-plot").slice(0, 2).map(e => e.getAttribute("aria-label")),
            banner: first(".spm-banner").getAttribute("role"),
            note: first(".spm-note").getAttribute("role"),
            title: document.title,
        }),
        // Names in the picture whose point is in it: text, and how far each reaches out (px).
        pictureNames: () => {
            const {camera, canvas, nodeRefFromName, nodePoseData} = window.__viserMutable;
            const ruler = document.createElement("canvas").getContext("2d");
            const nodes = Object.values(window.__viserSceneTree.getState());
            return nodes.filter(node => node.message.type == "LabelMessage"
                && node.effectiveVisibility).map(({message: {name, props}}) => {
                const parent = nodeRefFromName[name.replace(/\/[^/]*$/, "")];
                const point = camera.position.clone().set(...nodePoseData[name].position);
                point.applyMatrix4(parent.matrixWorld).project(camera);
                const x = (0.5 + 0.5 * point.x) * canvas.clientWidth;
                const y = (0.5 - 0.5 * point.y) * canvas.clientHeight;
                ruler.font = `${12 * props.font_screen_scale}px Arial, sans-serif`;
                const width = ruler.measureText(props.text).width;
                const [down, across] = props.anchor.split("-");
                const left = x - width * {left: 0, center: 0.5, right: 1}[across];
                const top = y - 12 * {top: 0, center: 0.5, bottom: 1}[down];
                const out = Math.max(-left, left + width - canvas.clientWidth, -top,
                    top + 12 - canvas.clientHeight);
                const isIn = x > 0 && x < canvas.clientWidth && y > 0 && y < canvas.clientHeight;
                return isIn ? [props.text, out] : null;
            }).filter(Boolean);
        },
        // Move the camera to the right and up (units of the scene), as a user does.
        moveCamera: (right, up) => window.__viserMutable.cameraControl.truck(right, -up, false),
        // From the camera to what it looks at (units of the scene).
        distance: () => window.__viserMutable.cameraControl.distance,
        camera: () => window.__viserMutable.camera.position.toArray(),
        background: () => {
            let e = window.__viserMutable.canvas;
            while (!e.style.backgroundColor) e = e.parentElement;
            return getComputedStyle(e).backgroundColor;
        },
        // Whether every line of the legend can be scrolled to, and is then in front.
        isLegendReachable: () => all(".spm-entry").every(line => {
            line.scrollIntoView({block: "nearest"});
            const {left, right, top, bottom} = place(line);
            return line.contains(document.elementFromPoint(
                (left + right) / 2, (top + bottom) / 2));
        }),
        // Keep what the page would download, and how far a text reaches out of a canvas (px).
        keepDownloads: () => {
            const write = CanvasRenderingContext2D.prototype.fillText;
            window.cutBy = 0;
            CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
                const end = new DOMPoint(x + this.measureText(text).width, 0);
                window.cutBy = Math.max(window.cutBy,
                    this.getTransform().transformPoint(end).x - this.canvas.width);
                return write.call(this, text, x, y);
            };
            HTMLAnchorElement.prototype.click = function () { window.saved = this.href; };
        },
    };
})();
