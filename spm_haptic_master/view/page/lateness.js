// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// How late the picture is. Each news has the clock of its program; how much longer than the
// fastest one it took is how late it is, and all that was drawn before it.
const lateness = (() => {
    // Drift of two clocks (s / s), which is followed while the picture is this little late (s).
    const DRIFT = 1e-4, IN_TIME = 0.1;
    let session = null, smallest = Infinity, lag = 0, heardAt = -Infinity;
    const seconds = () => performance.now() / 1000;
    return {
        hear: (news) => {
            const now = seconds(), way = now - news.clock;
            if (news.session !== session) [session, smallest] = [news.session, Infinity];
            else if (lag < IN_TIME) smallest += DRIFT * (now - heardAt);
            smallest = Math.min(smallest, way);
            lag = way - smallest;
            heardAt = now;
        },
        // Time by which the picture is too late (s); 0 if it is in time. Between two news it may be
        // as late as the time since the older one.
        late: () => {
            const oldest = lag + seconds() - heardAt;
            return lag > setup.latest || oldest > setup.oldest ? oldest : 0;
        },
    };
})();
