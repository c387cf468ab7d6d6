// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// The camera of this browser: it shows all devices until a user moves it.
const camera = (() => {
    // Time for which the renderer sets its own camera after the page has opened (ms).
    const OPENING = 6000;
    let views = setup.views, seen = null, isFree = true;
    const openedAt = performance.now();
    for (const kind of ['pointerdown', 'wheel']) {
        addEventListener(kind, ({target}) => { if (target.tagName === 'CANVAS') isFree = false; },
            {capture: true, passive: true});
    }

    // From the scene's frame to that of the renderer, by the turn of the scene's root.
    const turned = ([px, py, pz]) => {
        const [w, x, y, z] = window.__viserSceneTree.getState()[''].wxyz;
        const [tx, ty, tz] = [2 * (y * pz - z * py), 2 * (z * px - x * pz), 2 * (x * py - y * px)];
        return [px + w * tx + y * tz - z * ty, py + w * ty + z * tx - x * tz,
            pz + w * tz + x * ty - y * tx];
    };
    // The camera's angle is from top to bottom: a page that is higher than wide backs off, and its
    // panel is before the lower third.
    function aim([place, target], smoothly) {
        const control = window.__viserMutable?.cameraControl;
        const {clientWidth, clientHeight} = window.__viserMutable?.canvas ?? {};
        if (!control || !clientWidth || !window.__viserSceneTree?.getState()['']) return;
        const back = Math.min(Math.max(1, clientHeight / clientWidth), 3);
        const lower = innerWidth <= 576 ? 0.7 * (back - 1) : 0;
        const at = [target[0], target[1], target[2] - lower];
        const away = place.map((part, k) => at[k] + back * (part - target[k]));
        control.setLookAt(...turned(away), ...turned(at), smoothly);
    }
    const look = (view) => { isFree = true; aim(view, true); };
    return {
        look: (name) => look(views[name]),
        lookAt: look,
        // Keep all devices in the picture: of a page that opens, of another size, of another number
        // of devices.
        follow: (given) => {
            views = given;
            const now = JSON.stringify([views.front, innerWidth, innerHeight]);
            const isOpening = performance.now() - openedAt < OPENING;
            if (isFree && (isOpening || now !== seen)) aim(views.front, !isOpening);
            seen = now;
        },
    };
})();
