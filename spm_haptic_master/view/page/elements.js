// Copyright 2026 The spm_haptic_master maintainers
// SPDX-License-Identifier: Apache-2.0

// Elements of the page, and its colours. All files of this folder are one function of `setup`.
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
const button = (parent, text, act) => {
    const made = add(parent, 'button', '', text);
    made.type = 'button';
    made.onclick = act;
    return made;
};
const label = (element, text) => {
    if (element.getAttribute('aria-label') !== text) element.setAttribute('aria-label', text);
};
const isDark = () => document.documentElement.dataset.mantineColorScheme === 'dark';
const inkOf = ({light, dark}) => isDark() ? dark : light;
const rounded = (value) => Number.isFinite(value) ? String(Number(value.toPrecision(3))) : '–';
add(document.head, 'style', '', setup.css);
