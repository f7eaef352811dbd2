// Looks at the pixels of the view, in the page.

export const PAGE_TOOLS = `window.tools = (() => {
    // A quarter of the size is enough to tell.
    function pixels() {
        const view = document.getElementById('view');
        const flat = document.createElement('canvas');
        flat.width = Math.max(1, Math.round(view.width / 2));
        flat.height = Math.max(1, Math.round(view.height / 2));
        const context = flat.getContext('2d', { willReadFrequently: true });
        context.imageSmoothingEnabled = false;
        context.drawImage(view, 0, 0, flat.width, flat.height);
        return context.getImageData(0, 0, flat.width, flat.height).data;
    }
    const kinds = {
        green: (r, g, b) => g > 60 && g > 1.5 * r && g > 1.25 * b,
        violet: (r, g, b) => b > 60 && b > 1.2 * g && r > 1.05 * g && b > r,
        amber: (r, g, b) => r > 110 && r > 1.15 * g && g > 2 * b,
    };
    return {
        hash() {
            const p = pixels();
            let h = 2166136261;
            for (let i = 0; i < p.length; i += 4) h = Math.imul(h ^ (p[i] | (p[i + 1] << 8) | (p[i + 2] << 16)), 16777619);
            return h;
        },
        // Share of what is not background.
        share() {
            const p = pixels();
            let n = 0;
            for (let i = 0; i < p.length; i += 4) {
                if (Math.abs(p[i] - p[0]) + Math.abs(p[i + 1] - p[1]) + Math.abs(p[i + 2] - p[2]) > 24) n += 1;
            }
            return n / (p.length / 4);
        },
        count(kind) {
            const p = pixels();
            let n = 0;
            for (let i = 0; i < p.length; i += 4) n += kinds[kind](p[i], p[i + 1], p[i + 2]);
            return n;
        },
        // Brightness of the first pixel.
        corner() {
            const p = pixels();
            return (p[0] + p[1] + p[2]) / 3;
        },
    };
})();`;
