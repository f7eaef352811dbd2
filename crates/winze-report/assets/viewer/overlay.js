// What lies over the canvas: numbers of the places, names of marks, a scale, the axes.

function makeOverlay(stage, layer) {
    const tags = [];
    const v = new THREE.Vector3();

    function place(tag, width, height) {
        v.copy(tag.at()).project(stage.camera);
        const seen = v.z < 1 && Math.abs(v.x) < 1.02 && Math.abs(v.y) < 1.02 && tag.shown();
        tag.element.hidden = !seen;
        if (!seen) return;
        const x = ((v.x + 1) / 2) * width;
        const y = ((1 - v.y) / 2) * height;
        // A name stays inside, the number of a place stays where the place is.
        const pin = tag.element.classList.contains('pin');
        const over = pin ? 0 : Math.max(0, x + tag.element.offsetWidth + 20 - width);
        tag.element.style.transform = `translate(${(x - over).toFixed(1)}px, ${y.toFixed(1)}px)`;
    }

    const bar = layer.querySelector('.scale');
    const axes = [...layer.querySelectorAll('.axes line')];
    const names = [...layer.querySelectorAll('.axes text')];

    function scale(height) {
        const distance = stage.camera.position.distanceTo(stage.controls.target);
        const perPixel = (2 * distance * Math.tan((VIEW_ANGLE * Math.PI) / 360)) / height;
        const wanted = 110 * perPixel;
        const power = 10 ** Math.floor(Math.log10(wanted));
        const metres = [5, 2, 1].map((k) => k * power).find((m) => m <= wanted) || power;
        bar.style.width = `${(metres / perPixel).toFixed(1)}px`;
        bar.textContent = metres < 1 ? `${Math.round(metres * 100)} cm` : `${metres} m`;
    }

    function compass() {
        const turn = stage.camera.quaternion.clone().invert();
        [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, i) => {
            v.set(...axis).applyQuaternion(turn);
            const [x, y] = [32 + 22 * v.x, 32 - 22 * v.y];
            axes[i].setAttribute('x2', x.toFixed(1));
            axes[i].setAttribute('y2', y.toFixed(1));
            names[i].setAttribute('x', (32 + 29 * v.x).toFixed(1));
            names[i].setAttribute('y', (35.5 - 29 * v.y).toFixed(1));
        });
    }

    stage.onDraw.push(() => {
        const { clientWidth: width, clientHeight: height } = layer;
        tags.forEach((t) => place(t, width, height));
        scale(height);
        compass();
    });

    return {
        // A tag that follows a point of the scene: `at` and `shown` are asked at each drawing.
        tag(className, text, at, shown, chosen) {
            const element = document.createElement(chosen ? 'button' : 'span');
            element.className = `tag ${className}`;
            element.textContent = text;
            element.hidden = true;
            // The list beside says and does the same.
            element.setAttribute('aria-hidden', 'true');
            if (chosen) {
                element.type = 'button';
                element.tabIndex = -1;
                element.addEventListener('click', chosen);
            }
            layer.append(element);
            tags.push({ element, at, shown });
            return element;
        },
    };
}
