// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// Names in the picture are drawn to the side of their point that has the room: none is cut by an
// edge, whatever the size of the page and wherever a user moves the camera.
const names = (() => {
    // As the renderer draws them: size of the font (px), its family, and the blank around a text.
    const FONT = 12, BLANK = 0.25, LINE = 1.5;
    const FAMILY = '-apple-system, BlinkMacSystemFont, "Segoe UI", "Roboto", "Helvetica Neue", '
        + 'Arial, sans-serif';
    const ruler = document.createElement('canvas').getContext('2d');

    // Width and height of a name on the page (px).
    function sizeOf({text, font_screen_scale: scale}) {
        const font = FONT * scale;
        ruler.font = `${font}px ${FAMILY}`;
        return [ruler.measureText(text).width + 2 * BLANK * font, LINE * font];
    }

    // Where a part of the scene is in the picture (px), and whether it is before the camera.
    function placeOf(name, {camera, canvas, nodeRefFromName, nodePoseData}) {
        const parent = nodeRefFromName[name.slice(0, name.lastIndexOf('/'))];
        if (!parent) return null;
        const place = camera.position.clone().set(...nodePoseData[name]?.position ?? [0, 0, 0]);
        place.applyMatrix4(parent.matrixWorld).project(camera);
        return [0.5 * (1 + place.x) * canvas.clientWidth,
            0.5 * (1 - place.y) * canvas.clientHeight, place.z < 1];
    }

    // The side of a point to which a text of a length extends: to both, if there is room.
    function sideOf(at, length, end, [first, middle, last]) {
        if (at < 0.5 * length) return first;
        return at > end - 0.5 * length ? last : middle;
    }

    function anchorOf(name, props, viewer) {
        const place = placeOf(name, viewer);
        if (!place?.[2]) return props.anchor;
        const [width, height] = sizeOf(props);
        const {clientWidth, clientHeight} = viewer.canvas;
        const across = sideOf(place[0], width, clientWidth, ['left', 'center', 'right']);
        const down = sideOf(place[1], height, clientHeight, ['top', 'center', 'bottom']);
        return `${down}-${across}`;
    }

    return {
        keepInPicture: () => {
            const viewer = window.__viserMutable;
            if (!viewer?.camera || !viewer.canvas?.clientWidth) return;
            for (const {message} of Object.values(window.__viserSceneTree.getState())) {
                if (message.type !== 'LabelMessage') continue;
                const {name, owner, props} = message;
                const anchor = anchorOf(name, props, viewer);
                if (anchor !== props.anchor) {
                    past.change({type: 'SceneNodeUpdateMessage', name, owner, updates: {anchor}});
                }
            }
        },
    };
})();
