// Brings the page to life. Without WebGL the flat picture stays.

const LIGHT = matchMedia('(prefers-color-scheme: light)');
const schemeOf = () => (LIGHT.matches ? 'light' : 'dark');

// Shows a scene in the place of the one that is shown; the canvas is a new one, since a context is drawn in by one view alone.
function open(shown, index, update) {
    let canvas = document.getElementById('view');
    const layer = document.getElementById('layer');
    if (shown.view) {
        shown.view.stage.end();
        const fresh = canvas.cloneNode(false);
        canvas.replaceWith(fresh);
        canvas = fresh;
        layer.querySelectorAll('.tag').forEach((t) => t.remove());
    }
    shown.scene = readScene(`scene-${index}`);
    shown.view = makeView(shown.scene, canvas, layer);
    shown.view.onChange(update);
    shown.view.begin(schemeOf());
    // For the console, and for tests.
    window.winze = shown.view;
}

function begin() {
    if (!document.getElementById('scene-0') || !document.getElementById('view')) return;
    document.documentElement.classList.add('live');
    const shown = { view: null, scene: null };
    const update = bindPanel(shown);
    try {
        open(shown, 0, update);
    } catch {
        document.documentElement.classList.remove('live');
        return;
    }
    bindKeys(shown);
    LIGHT.addEventListener('change', () => shown.view.setScheme(schemeOf()));
    const runs = [...document.querySelectorAll('[data-run]')];
    const choose = (run) => {
        runs.forEach((r) => r.setAttribute('aria-pressed', String(r === run)));
        document.querySelectorAll('[data-about]').forEach((e) => (e.hidden = e.dataset.about !== run.dataset.run));
        open(shown, Number(run.dataset.run), update);
    };
    runs.forEach((r) => r.addEventListener('click', () => choose(r)));
}

begin();
