// By keyboard: all of it, with the view in focus; letters and numbers anywhere on the page.

function bindKeys(view, canvas) {
    const turn = 0.12;
    const stage = view.stage;
    const onView = {
        ArrowLeft: (e) => (e.shiftKey ? shiftCamera(stage, -0.06, 0) : turnCamera(stage, -turn, 0)),
        ArrowRight: (e) => (e.shiftKey ? shiftCamera(stage, 0.06, 0) : turnCamera(stage, turn, 0)),
        ArrowUp: (e) => (e.shiftKey ? shiftCamera(stage, 0, 0.06) : turnCamera(stage, 0, turn)),
        ArrowDown: (e) => (e.shiftKey ? shiftCamera(stage, 0, -0.06) : turnCamera(stage, 0, -turn)),
        '+': () => zoomCamera(stage, 0.85),
        '=': () => zoomCamera(stage, 0.85),
        '-': () => zoomCamera(stage, 1 / 0.85),
    };
    const anywhere = {
        b: () => view.setBefore(!view.state.before),
        r: () => view.setColouring('residuals'),
        g: () => view.setColouring('plain'),
        p: () => view.setColouring('patches'),
        w: () => view.wholeMap(),
        q: () => view.nearQuery(),
        a: () => view.fromAbove(),
        m: () => view.setMap(!view.state.map),
        '[': () => view.setCut(Math.max(0, Math.min(view.state.cut, 1) - 0.05)),
        ']': () => view.setCut(Math.min(1, view.state.cut + 0.05)),
    };
    document.addEventListener('keydown', (e) => {
        if (e.ctrlKey || e.metaKey || e.altKey) return;
        if (e.target.matches('input[type="text"], textarea, select')) return;
        const key = e.key.length === 1 ? e.key.toLowerCase() : e.key;
        let act = document.activeElement === canvas ? onView[key] : null;
        act = act || anywhere[key];
        if (!act && /^[1-9]$/.test(key)) act = () => view.choose(Number(key) - 1);
        if (key === 'p' && !document.querySelector('[data-colour="patches"]')) act = null;
        if (key === 'r' && !document.querySelector('[data-colour="residuals"]')) act = null;
        if (!act) return;
        e.preventDefault();
        act(e);
    });
}
