// The buttons, the list of places and the legend. `shown` holds the view and its scene, which may be changed for others.

function bindPanel(shown) {
    const all = (selector) => [...document.querySelectorAll(selector)];
    const press = (buttons, chosen) => buttons.forEach((b) => b.setAttribute('aria-pressed', String(b === chosen)));
    const on = (selector, act) => all(selector).forEach((b) => b.addEventListener('click', () => act(b.dataset)));

    on('[data-when]', (d) => shown.view.setBefore(d.when === 'before'));
    on('[data-colour]', (d) => shown.view.setColouring(d.colour));
    on('[data-look]', (d) => shown.view[d.look]());
    const cut = document.getElementById('cut');
    cut.addEventListener('input', () => shown.view.setCut(Number(cut.value) / 100));
    const factor = document.getElementById('factor');
    if (factor) {
        factor.addEventListener('change', () => shown.view.setFactor(Number(factor.value)));
    }

    const rows = all('.place');
    rows.forEach((row, i) => row.addEventListener('click', () => shown.view.choose(i)));
    const list = document.getElementById('places');
    if (list) {
        list.addEventListener('keydown', (e) => {
            const step = { ArrowDown: 1, ArrowRight: 1, ArrowUp: -1, ArrowLeft: -1 }[e.key];
            if (!step) return;
            e.preventDefault();
            const many = shown.scene.places.length;
            const next = (shown.view.state.place + step + many) % many;
            shown.view.choose(next);
            rows[next].focus();
        });
    }

    const says = document.getElementById('says');
    const cutSays = document.getElementById('cut-says');
    const update = (state) => {
        const { view, scene } = shown;
        press(all('[data-when]'), document.querySelector(`[data-when="${state.before ? 'before' : 'after'}"]`));
        press(all('[data-colour]'), document.querySelector(`[data-colour="${state.colouring}"]`));
        rows.forEach((row, i) => {
            const own = i === state.place && !state.before;
            row.setAttribute('aria-checked', String(own));
            row.hidden = i >= scene.places.length;
            row.tabIndex = i === Math.max(state.place, 0) ? 0 : -1;
        });
        all('[data-legend]').forEach((l) => {
            const colouring = state.before || state.place < 0 ? 'plain' : state.colouring;
            l.hidden = l.dataset.legend !== colouring;
        });
        all('[data-only="before"]').forEach((e) => (e.hidden = !state.before));
        const place = scene.places[state.place];
        const unasked = place && state.colouring === 'patches' && !state.before && scene.patches && !scene.patches.answers[state.place];
        all('[data-only="unasked"]').forEach((e) => {
            e.hidden = !unasked;
            if (unasked) e.textContent = place.piecewise ? 'The query is bent: its rock was asked piece by piece at this place, which is not drawn.' : 'The rock was not asked at this place.';
        });
        if (place) {
            const parts = { fine: place.fine, near: place.overlap - place.fine, off: 1 - place.overlap };
            for (const [name, share] of Object.entries(parts)) {
                const text = `${Math.round(100 * share)} %`;
                all(`[data-part="${name}"]`).forEach((e) => (e.style.flexGrow = String(Math.max(share, 0.001))));
                all(`[data-share="${name}"]`).forEach((e) => (e.textContent = text));
            }
        }
        cut.value = String(Math.round(100 * state.cut));
        const height = view.cutHeight();
        const text = height === null ? 'not cut' : `cut ${height.toFixed(1)} m ${height < 0 ? 'below' : 'above'} its middle`.replace('-', '');
        cutSays.textContent = text;
        cut.setAttribute('aria-valuetext', text);
        if (factor && ![...factor.options].some((o) => Number(o.value) === state.factor)) factor.append(new Option(`×${state.factor}`, state.factor));
        if (factor) factor.value = String(state.factor);
        const where = state.before || !place ? 'the query as it came' : `place ${place.index + 1} of ${scene.places.length}${place.rival ? ', which cannot be ruled out' : ''}`;
        const say = `Shown: ${where}.`;
        if (says.textContent !== say) says.textContent = say;
    };

    all('[data-copy]').forEach((b) => {
        b.addEventListener('click', async () => {
            const text = document.getElementById(b.dataset.copy).textContent;
            const done = await copy(text);
            b.textContent = done ? 'Copied' : 'Select and copy it';
            setTimeout(() => (b.textContent = 'Copy'), 1600);
        });
    });
    return update;
}

// A page opened from a file may not have the clipboard: then the old way.
async function copy(text) {
    try {
        await navigator.clipboard.writeText(text);
        return true;
    } catch {
        const area = document.createElement('textarea');
        area.value = text;
        document.body.append(area);
        area.select();
        const done = document.execCommand('copy');
        area.remove();
        return done;
    }
}
