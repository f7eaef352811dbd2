// A page in a headless Chromium, with everything that goes wrong in it.

import puppeteer from 'puppeteer-core';
import { PAGE_TOOLS } from './pixels.mjs';

// Software rendering: what checks run on has no graphics card.
const DRAWING = ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'];
const FLAT = ['--disable-gpu', '--disable-3d-apis'];

export async function open(url, { webgl = true, scripts = true }) {
    const browser = await puppeteer.launch({
        executablePath: process.env.CHROMIUM || '/usr/bin/chromium',
        headless: true,
        args: ['--no-sandbox', '--disable-dev-shm-usage', ...(webgl ? DRAWING : FLAT)],
    });
    const page = await browser.newPage();
    const trouble = [];
    page.on('console', (m) => {
        // Reading the drawing buffer back slows the driver down, of which it tells.
        if (m.type() === 'error') trouble.push(m.text());
    });
    page.on('pageerror', (e) => trouble.push(e.message));
    page.on('request', (r) => {
        if (r.url() !== url && !r.url().startsWith('data:')) trouble.push(`asks for ${r.url().slice(0, 100)}`);
    });
    await page.setJavaScriptEnabled(scripts);
    await page.setViewport({ width: 1366, height: 768 });
    await page.emulateMediaFeatures([
        { name: 'prefers-color-scheme', value: 'dark' },
        { name: 'prefers-reduced-motion', value: 'reduce' },
    ]);
    await page.evaluateOnNewDocument(PAGE_TOOLS);
    await page.goto(url, { waitUntil: 'load' });
    if (webgl && scripts) {
        await ready(page);
    }
    return { browser, page, trouble };
}

// Until what was asked to be drawn is drawn.
export async function settle(page) {
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
    await page.waitForFunction(() => !window.winze.stage.waiting, { timeout: 30000 });
}

// Until the page has come to life; another size may have loaded it anew.
export async function ready(page) {
    await page.waitForFunction(() => window.winze && window.winze.stage.drawn > 0, { timeout: 30000 });
    await settle(page);
}
