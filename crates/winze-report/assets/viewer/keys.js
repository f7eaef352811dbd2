// By keyboard: all of it, with the view in focus; letters and numbers anywhere on the page.

function bindKeys(shown) {
    const turn = 0.12;
    const onView = {
        ArrowLeft: (e) => (e.shiftKey ? shiftCamera(shown.view.stage, -0.06, 0) : turnCamera(shown.view.stage, -turn, 0)),
        ArrowRight: (e) => (e.shiftKey ? shiftCamera(shown.view.stage, 0.06, 0) : turnCamera(shown.view.stage, turn, 0)),
        ArrowUp: (e) => (e.shiftKey ? shiftCamera(shown.view.stage, 0, 0.06) : turnCamera(shown.view.stage, 0, turn)),
        ArrowDown: (e) => (e.shiftKey ? shiftCamera(shown.view.stage, 0, -0.06) : turnCamera(shown.view.stage, 0, -turn)),
        '+': () => zoomCamera(shown.view.stage, 0.85),
        '=': () => zoomCamera(shown.view.stage, 0.85),
        '-': () => zoomCamera(shown.view.stage, 1 / 0.85),
    };
    const anywhere = {
        b: () => shown.view.setBefore(!shown.view.state.before),
        r: () => shown.view.setColouring('residuals'),
        g: () => shown.view.setColouring('plain'),
        p: () => shown.view.setColouring('patches'),
        w: () => shown.view.wholeMap(),
        q: () => shown.view.nearQuery(),
        a: () => shown.view.fromAbove(),
        m: () => shown.view.setMap(!shown.view.state.map),
        '[': () => shown.view.setCut(Math.max(0, Math.min(shown.view.state.cut, 1) - 0.05)),
        ']': () => shown.view.setCut(Math.min(1, shown.view.state.cut + 0.05)),
    };
    document.addEventListener('keydown', (e) => {
        if (e.ctrlKey || e.metaKey || e.altKey) return;
        if (e.target.matches('input[type="text"], textarea, select')) return;
        const key = e.key.length === 1 ? e.key.toLowerCase() : e.key;
        let act = document.activeElement.id === 'view' ? onView[key] : null;
        act = act || anywhere[key];
        if (!act && /^[1-9]$/.test(key)) act = () => shown.view.choose(Number(key) - 1);
        if (key === 'p' && !document.querySelector('[data-colour="patches"]')) act = null;
        if (key === 'r' && !document.querySelector('[data-colour="residuals"]')) act = null;
        if (!act) return;
        e.preventDefault();
        act(e);
    });
}
