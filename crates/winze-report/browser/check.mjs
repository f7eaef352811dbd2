// Opens reports in a headless Chromium, turns, clicks and types, and checks what is drawn.
//
//     npm ci && node check.mjs [--shots FOLDER] [VERDICT=]REPORT.html...
//
// With a verdict before its name, a report must have that one. Prints what was checked; exits 1 where something was not as it should be. CHROMIUM names another browser than /usr/bin/chromium.

import { mkdirSync } from 'node:fs';
import { basename, join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';
import { open, ready, settle } from './open.mjs';

const args = process.argv.slice(2);
const at = args.indexOf('--shots');
const shots = at >= 0 ? args.splice(at, 2)[1] : null;
if (args.length === 0) {
    console.error('check.mjs: name a report');
    process.exit(2);
}
if (shots) mkdirSync(shots, { recursive: true });

let failures = 0;
let checks = 0;
function check(ok, what, more = '') {
    checks += 1;
    if (!ok) failures += 1;
    console.log(`  ${ok ? 'ok  ' : 'FAIL'} ${what}${ok || more === '' ? '' : `: ${more}`}`);
}

// The first report is looked at in all of them, the others on a phone.
const SIZES = [[360, 740], [768, 1024], [1366, 768], [1920, 1080]];

const VERDICTS = /^(located|ambiguous|degenerate|not_found|insufficient)=(.+)$/;
const reports = args.map((arg) => {
    const [, verdict, file] = arg.match(VERDICTS) || [arg, null, arg];
    return { verdict, file };
});

const first = pathToFileURL(resolve(reports[0].file)).href;
for (const { verdict, file } of reports) {
    const begun = Date.now();
    console.log(file);
    const url = pathToFileURL(resolve(file)).href;
    await looks(url, basename(file, '.html'), verdict);
    if (url === first) await withoutWebgl(url);
    console.log(`  ${((Date.now() - begun) / 1000).toFixed(1)} s`);
}
console.log(`${checks} checks, ${failures} failed`);
process.exit(failures ? 1 : 0);

// Everything that is looked at in a browser that can draw.
async function looks(url, name, verdict) {
    const { browser, page, trouble } = await open(url, {});
    try {
        const facts = await page.evaluate(() => ({
            verdict: JSON.parse(document.getElementById('json').textContent).verdict,
            places: document.querySelectorAll('.place').length,
            patches: Boolean(document.querySelector('[data-colour="patches"]')),
            open: JSON.parse(document.getElementById('scene-0').textContent).open.length,
        }));
        console.log(`  (${facts.verdict}, ${facts.places} places)`);
        if (verdict) check(facts.verdict === verdict, `the verdict is ${verdict}`, facts.verdict);
        await drawn(page, facts);
        await turning(page);
        if (facts.places > 0) await choosing(page, facts);
        await reasons(page, facts);
        await keyboard(page, facts);
        await colours(page, name);
        await sizes(page, name, url === first ? SIZES : SIZES.slice(0, 1));
        check(trouble.length === 0, 'no request, no error', trouble.join('; '));
    } finally {
        await browser.close();
    }
}

// Does what a person would, and tells whether the picture has changed.
async function changes(page, what, act) {
    const before = await page.evaluate(() => tools.hash());
    await act();
    await settle(page);
    const after = await page.evaluate(() => tools.hash());
    check(before !== after, what);
}

async function drawn(page, facts) {
    const share = await page.evaluate(() => tools.share());
    check(share > 0.02, 'the canvas is drawn', `${(100 * share).toFixed(2)} %`);
    await page.keyboard.press('g');
    await settle(page);
    const green = await page.evaluate(() => tools.count('green'));
    const violet = await page.evaluate(() => tools.count('violet'));
    check(green > 30, 'the query is green in it', `${green} pixels`);
    check(violet > 1000, 'and the map violet', `${violet} pixels`);
    if (facts.places === 0) return;
    await changes(page, 'residuals colour it', () => page.click('[data-colour="residuals"]'));
    const legend = await page.$eval('[data-legend="residuals"]', (e) => !e.hidden && /cm/.test(e.textContent));
    check(legend, 'with a legend in centimetres');
    if (facts.patches) {
        await changes(page, 'the rock colours it', () => page.click('[data-colour="patches"]'));
        await page.click('[data-colour="residuals"]');
        await settle(page);
    }
    // Residuals have a yellow of their own.
    await page.keyboard.press('g');
    await settle(page);
    if (facts.open > 0) {
        const amber = await page.evaluate(() => tools.count('amber'));
        const named = await page.$$eval('.tag.open', (tags) => tags.some((t) => !t.hidden));
        check(amber > 100 && named, 'open directions are drawn and named', `${amber} pixels`);
    }
    if (facts.verdict === 'ambiguous') {
        const amber = await page.evaluate(() => tools.count('amber'));
        check(amber > 100, 'the other place is drawn as well', `${amber} pixels`);
    }
    await page.keyboard.press('r');
    await settle(page);
    if (facts.verdict === 'ambiguous') {
        const told = await page.$eval('[data-legend="residuals"]', (e) => /could lie as well/.test(e.textContent));
        check(told, 'and the legend says what it is');
    }
    await restored(page);
}

// A browser may take the graphics card away and give it back.
async function restored(page) {
    // Not to the bit: with open directions and the ellipsoid drawn, some pixels differ, it is not known why.
    const seen = () => page.evaluate(() => [tools.share(), tools.count('amber'), tools.count('violet')]);
    const before = await seen();
    await page.evaluate(() => new Promise((done) => {
        const canvas = document.getElementById('view');
        const lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context');
        canvas.addEventListener('webglcontextrestored', () => setTimeout(done, 0), { once: true });
        canvas.addEventListener('webglcontextlost', () => setTimeout(() => lose.restoreContext(), 50), { once: true });
        lose.loseContext();
    }));
    await settle(page);
    const after = await seen();
    const alike = before.every((v, i) => Math.abs(after[i] - v) <= 0.02 * v);
    check(alike, 'what was drawn is drawn again after the context was lost', `${before} then ${after}`);
}

async function turning(page) {
    const box = await (await page.$('#view')).boundingBox();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 3];
    await changes(page, 'dragging turns it', async () => {
        await page.mouse.move(x, y);
        await page.mouse.down();
        await page.mouse.move(x + 140, y + 30, { steps: 4 });
        await page.mouse.up();
    });
    await changes(page, 'the wheel zooms', () => page.mouse.wheel({ deltaY: -240 }));
    await page.focus('#view');
    for (const key of ['ArrowLeft', 'ArrowUp', '+', '-']) {
        await changes(page, `${key} does something`, () => page.keyboard.press(key));
    }
    await changes(page, 'W shows the whole map', () => page.keyboard.press('w'));
    await changes(page, 'M hides the map', () => page.keyboard.press('m'));
    await page.keyboard.press('m');
    await page.keyboard.press('q');
    await changes(page, '[ cuts the roof', async () => {
        for (let i = 0; i < 9; i++) await page.keyboard.press('[');
    });
    for (let i = 0; i < 9; i++) await page.keyboard.press(']');
    await settle(page);
}

async function choosing(page, facts) {
    const shown = () => page.evaluate(() => ({ place: winze.state.place, before: winze.state.before }));
    await changes(page, 'B shows it before', () => page.keyboard.press('b'));
    check((await shown()).before, 'and says so');
    check(await page.$eval('.note', (e) => !e.hidden), 'in a note');
    await page.click('[data-when="after"]');
    await settle(page);
    if (facts.places < 2) return;
    await changes(page, 'a click chooses another place', () => page.evaluate(() => document.querySelectorAll('.place')[1].click()));
    check((await shown()).place === 1, 'the second');
    const checked = await page.$$eval('.place', (rows) => rows.map((r) => r.getAttribute('aria-checked')).join());
    check(checked.startsWith('false,true'), 'which is marked in the list', checked);
    await changes(page, '1 chooses the first', () => page.keyboard.press('1'));
    await page.focus('.place[aria-checked="true"]');
    await changes(page, 'the down key goes on in the list', () => page.keyboard.press('ArrowDown'));
    check((await shown()).place === 1, 'to the second');
    await page.keyboard.press('1');
    await page.focus('#view');
    await settle(page);
}

async function reasons(page, facts) {
    const rows = await page.$$eval('.why li', (all) => all.map((li) => ({
        unmet: li.classList.contains('no'),
        decides: li.classList.contains('decides'),
        wanted: li.querySelector('.wanted').textContent,
    })));
    check(rows.length > 0 && rows.every((r) => r.wanted.length > 0), 'each reason stands beside what is wanted');
    const deciding = rows.filter((r) => r.decides).length;
    if (facts.verdict === 'located') check(rows.every((r) => !r.unmet), 'all are met');
    else check(deciding === 1, 'one of them decides', `${deciding}`);
    check(await page.$eval('#command', (e) => e.textContent.startsWith('winze ')), 'the command is there');
    const text = await page.$eval('.again', (e) => e.textContent);
    check(/sha256:[0-9a-f]{8}/.test(text), 'and digests');
}

// What Tab reaches must be all there is.
async function keyboard(page) {
    await page.evaluate(() => document.activeElement.blur());
    const reached = new Set();
    for (let i = 0; i < 60; i++) {
        await page.keyboard.press('Tab');
        reached.add(await page.evaluate(() => {
            const e = document.activeElement;
            return e.id || e.dataset.when || e.dataset.colour || e.dataset.look || e.dataset.copy || e.className || e.tagName;
        }));
    }
    await page.evaluate(() => document.activeElement.blur());
    const wanted = await page.evaluate(() => [...document.querySelectorAll('[data-when], [data-colour], [data-look], #cut, #factor, #view')]
        .map((e) => e.id || e.dataset.when || e.dataset.colour || e.dataset.look));
    const missing = wanted.filter((w) => !reached.has(w));
    check(missing.length === 0, 'Tab reaches every control', missing.join());
    const nameless = await page.$$eval('button, canvas, input, select', (all) => all.filter((e) => !(e.textContent.trim() || e.getAttribute('aria-label') || e.labels?.length)).length);
    check(nameless === 0, 'every control has a name', `${nameless}`);
}

async function colours(page, name) {
    const corner = async (scheme) => {
        await page.emulateMediaFeatures([
            { name: 'prefers-color-scheme', value: scheme },
            { name: 'prefers-reduced-motion', value: 'reduce' },
        ]);
        await settle(page);
        if (shots) await page.screenshot({ path: join(shots, `${name}-${scheme}.png`) });
        const paper = await page.evaluate(() => getComputedStyle(document.body).backgroundColor);
        return { scene: await page.evaluate(() => tools.corner()), paper };
    };
    const light = await corner('light');
    const dark = await corner('dark');
    check(light.scene > 200 && dark.scene < 60, 'the scene is light or dark as asked', `${light.scene}, ${dark.scene}`);
    check(light.paper !== dark.paper, 'and so is the page');
}

async function sizes(page, name, all) {
    for (const [width, height] of all) {
        await page.setViewport({ width, height, isMobile: width < 500, hasTouch: width < 500 });
        await ready(page);
        const over = await page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
        const share = await page.evaluate(() => tools.share());
        check(over <= 0 && share > 0.01, `fits ${width} × ${height}`, `${over} px too wide, ${(100 * share).toFixed(1)} % drawn`);
        if (shots) await page.screenshot({ path: join(shots, `${name}-${width}.png`), fullPage: width < 500 });
    }
}

// A browser that cannot draw shows the flat picture.
async function withoutWebgl(url) {
    for (const [what, options] of [['without WebGL', { webgl: false }], ['without scripts', { scripts: false }]]) {
        const { browser, page } = await open(url, options);
        const seen = await page.$eval('.picture img', (e) => e.getBoundingClientRect().width > 100 && e.complete && e.naturalWidth > 100);
        const stage = await page.$eval('.stage', (e) => e.getBoundingClientRect().width);
        check(seen && stage === 0, `${what} the flat picture is shown`);
        await browser.close();
    }
}
