// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// The picture of then: what the devices' parts were changed to at a time, kept with each sample of
// the plots, and shown while the page is paused.
const past = (() => {
    const CHANGES = new Set(['SetOrientationMessage', 'SetPositionMessage',
        'SetSceneNodeVisibilityMessage', 'SceneNodeUpdateMessage']);
    let queue = null, latest = new Map(), isHeld = false;
    const isOfDevice = ({name}) => typeof name === 'string' && name.startsWith('/arm');
    const keyOf = ({type, name, updates}) => `${type} ${name} ${Object.keys(updates ?? {})}`;
    const draw = (changes) => {
        if (!queue) return;
        for (const change of changes.values()) Array.prototype.push.call(queue, change);
        window.__viserMutable.requestRender?.();
    };
    // What the renderer is to draw comes by its queue.
    function push(...messages) {
        for (const message of messages) {
            if (isOfDevice(message)) {
                if (CHANGES.has(message.type)) {
                    latest.set(keyOf(message), message);
                    if (isHeld) continue;
                } else latest = new Map();  // another device, or another mechanism
            }
            Array.prototype.push.call(queue, message);
        }
        return queue.length;
    }
    return {
        attach: () => {
            const found = window.__viserMutable?.messageQueue;
            if (!found || found === queue) return;
            queue = found;
            queue.push = push;
        },
        // The parts as they are drawn now.
        snapshot: () => new Map(latest),
        // A change of this page alone, also while it is paused.
        change: (message) => draw(new Map([['', message]])),
        show: (changes) => {
            isHeld = true;
            if (changes) draw(changes);
        },
        release: () => {
            if (isHeld) draw(latest);
            isHeld = false;
        },
    };
})();
