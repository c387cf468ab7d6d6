// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// What is on the page beside picture and panel, of the messages of `Page`: it only shows, sends
// nothing, and what a user operates here (pause, views, save, dark) reaches nobody else.
const banners = add(document.body, 'div', 'spm-banners');
const cover = add(document.body, 'div', 'spm-lost');
cover.setAttribute('role', 'alert');
const tools = add(document.body, 'div', 'spm-tools');
tools.setAttribute('role', 'toolbar');
label(tools, 'views, picture, legend');

// viser connects again only while its page has the focus: one on a wall would never return.
document.hasFocus = () => !document.hidden;

// Tools: the colours of the dome, views, a file, a dark page, and the legend.
add(tools, 'div', '', 'dome: dexterity of three encoders');
add(tools, 'div', 'spm-dome').style.background = `linear-gradient(90deg,${setup.dome.colours})`;
const scale = add(tools, 'div', 'spm-scale');
for (const text of setup.dome.words) add(scale, 'span', '', text);
for (const name of Object.keys(setup.views)) button(tools, name, () => camera.look(name));
add(tools, 'br');
button(tools, 'save picture', () => plots.save(panel.first(), wordsOfBanners()));
button(tools, 'dark', () => {
    const address = new URL(location), dark = !isDark();
    document.documentElement.dataset.mantineColorScheme = dark ? 'dark' : 'light';
    address.searchParams.delete('darkMode');
    if (dark) address.searchParams.set('darkMode', '');
    history.replaceState(null, '', address);
    panel.draw();
    fillLegend();
});
const legend = add(document.body, 'div', 'spm-legend');
legend.setAttribute('role', 'dialog');
label(legend, 'legend');
legend.hidden = true;
const opener = button(tools, 'legend', () => showLegend(legend.hidden));
opener.setAttribute('aria-expanded', 'false');

function fillLegend() {
    legend.replaceChildren();
    const head = add(legend, 'div', 'spm-head');
    add(head, 'b', '', 'legend');
    button(head, 'close', () => showLegend(false));
    for (const {sign, ink, text} of setup.legend) {
        const line = add(legend, 'div', 'spm-entry');
        add(line, 'b', '', sign).style.color = inkOf(ink);
        add(line, 'span', '', text);
    }
}
function showLegend(shown) {
    fillLegend();
    legend.hidden = !shown;
    opener.setAttribute('aria-expanded', String(shown));
    (shown ? legend.querySelector('button') : opener).focus();
}
addEventListener('keydown', ({key}) => { if (key === 'Escape' && !legend.hidden) showLegend(false); });

const wordsOfBanners = () => [...banners.children].map(({textContent}) => textContent).join('; ');
let shownBanners;
function showBanners(devices) {
    const heads = JSON.stringify(devices.map(({banner}) => banner));
    if (heads === shownBanners) return;
    shownBanners = heads;
    devices.forEach(({banner: {text, sign, colour, light, alive}}, index) => {
        const banner = banners.children[index] ?? add(banners, 'div', 'spm-banner');
        banner.setAttribute('role', light === 'RED' ? 'alert' : 'status');
        put(banner, text);
        banner.dataset.sign = sign;
        banner.style.background = colour;
        banner.dataset.alive = Number(alive);
    });
    while (banners.children.length > devices.length) banners.lastChild.remove();
    // On a phone the tools are below them.
    document.body.style.setProperty('--spm-banners', `${banners.offsetHeight}px`);
}

// viser's button of the story to try: that of the first device, none of one that is not simulated.
const storyButton = () => [...document.querySelectorAll('button')].find(
    ({textContent}) => textContent.trim() === setup.introduction.story);

// The line under the title: what this is, and a button of what to try.
function introduce(hasDevice) {
    const host = document.getElementById('spm-introduction');
    if (!host) return;
    if (!host.firstChild) {
        const line = add(host, 'div', 'spm-device spm-introduction');
        add(line, 'span', '', `${setup.introduction.text} `);
        button(line, `Try: ${setup.introduction.story}`, () => storyButton()?.click());
    }
    // Only a simulated device has something to try.
    host.firstChild.lastChild.hidden = !storyButton();
    document.body.classList.toggle('spm-empty', !hasDevice);
}

function coverIfLate() {
    const late = lateness.late();
    if (late) put(cover, `The picture is ${late.toFixed(0)} s late: it is not the device of now.`);
    cover.style.visibility = late ? 'visible' : 'hidden';
}
setInterval(coverIfLate, 100);
setInterval(() => names.keepInPicture(), 100);

return {
    show: (news) => {
        lateness.hear(news);
        coverIfLate();
        past.attach();
        showBanners(news.devices);
        const titles = news.devices.map(({name}) => name).filter(Boolean);
        document.title = [titles.join(', '), 'haptic master'].filter(Boolean).join(' - ');
        camera.follow(news.views);
        introduce(news.hasDevice);
        label(window.__viserMutable?.canvas ?? cover, 'picture of the device in 3D');
        panel.keep(new Set(news.devices.map(({name}) => name)));
        for (const device of news.devices) if (device.content) panel.show(device);
    },
};
