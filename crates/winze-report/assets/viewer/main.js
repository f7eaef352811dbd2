// Brings the page to life. Without WebGL the flat picture stays.

function begin() {
    const scene = readScene('scene');
    const canvas = document.getElementById('view');
    if (!scene || !canvas) return;
    document.documentElement.classList.add('live');
    let view;
    try {
        view = makeView(scene, canvas, document.getElementById('layer'));
    } catch (e) {
        document.documentElement.classList.remove('live');
        document.documentElement.classList.add('flat');
        return;
    }
    bindPanel(view, scene);
    bindKeys(view, canvas);
    const light = matchMedia('(prefers-color-scheme: light)');
    const scheme = () => (light.matches ? 'light' : 'dark');
    light.addEventListener('change', () => view.setScheme(scheme()));
    view.begin(scheme());
    // For the console, and for tests.
    window.winze = view;
}

begin();
