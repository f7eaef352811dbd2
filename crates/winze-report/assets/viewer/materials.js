// Shaders: points whose size attenuates, and light from depth alone (Boucheny 2009), which gives bare points a shape.

const POINT_VERTEX = `
attribute float residual;
uniform float size, perMetre, pixelRatio, cut, bias, fogNear, fogFar;
uniform vec3 colour, offMap;
uniform vec3 ramp[3];
uniform float mode, fineAt;
varying vec3 tint;
varying float haze, round;
void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * seen;
    // What lies on the map's surface must not flicker with it.
    vec4 nearer = projectionMatrix * vec4(seen.xy, min(seen.z + bias, -0.01), 1.0);
    gl_Position.z = nearer.z / nearer.w * gl_Position.w;
    if (world.z > cut) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    float pixels = size * perMetre / max(-seen.z, 0.01);
    gl_PointSize = clamp(pixels, 1.3 * pixelRatio, 26.0 * pixelRatio);
    round = step(3.0, gl_PointSize);
    haze = smoothstep(fogNear, fogFar, -seen.z);
    tint = colour;
    if (mode > 0.5) {
        float r = residual * 255.0 / 254.0;
        tint = r < fineAt ? mix(ramp[0], ramp[1], r / fineAt) : mix(ramp[1], ramp[2], min((r - fineAt) / (1.0 - fineAt), 1.0));
        if (residual > 0.999) tint = offMap;
    }
}`;

const POINT_FRAGMENT = `
uniform vec3 background;
varying vec3 tint;
varying float haze, round;
void main() {
    vec2 off = gl_PointCoord - 0.5;
    if (round * dot(off, off) > 0.25) discard;
    gl_FragColor = vec4(mix(tint, background, 0.72 * haze), 1.0);
}`;

const DISC_VERTEX = `
attribute vec3 discColour;
uniform float cut, bias;
varying vec3 tint;
void main() {
    vec4 world = modelMatrix * vec4(position, 1.0);
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * seen;
    vec4 nearer = projectionMatrix * vec4(seen.xy, min(seen.z + bias, -0.01), 1.0);
    gl_Position.z = nearer.z / nearer.w * gl_Position.w;
    if (world.z > cut) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    tint = discColour;
}`;

const DISC_FRAGMENT = `
varying vec3 tint;
void main() { gl_FragColor = vec4(tint, 1.0); }`;

const LIGHT_VERTEX = `
varying vec2 at;
void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }`;

const LIGHT_FRAGMENT = `
uniform sampler2D picture, depth;
uniform vec2 pixel;
uniform float near, far, strength, darkest;
uniform vec3 background;
varying vec2 at;
float distanceOf(float d) { return near * far / (far - d * (far - near)); }
void main() {
    float d = texture2D(depth, at).x;
    if (d >= 1.0) { gl_FragColor = vec4(background, 1.0); return; }
    float own = log2(distanceOf(d)), shadow = 0.0;
    for (int i = 0; i < 8; i++) {
        float a = float(i) * 0.785398;
        float n = texture2D(depth, at + pixel * vec2(cos(a), sin(a))).x;
        if (n < 1.0) shadow += max(0.0, own - log2(distanceOf(n)));
    }
    vec3 lit = texture2D(picture, at).rgb * mix(darkest, 1.0, exp(-shadow / 8.0 * strength));
    gl_FragColor = vec4(lit, 1.0);
}`;

function vectorOf(hex) {
    const n = parseInt(hex.slice(1), 16);
    return new THREE.Vector3((n >> 16) / 255, ((n >> 8) & 255) / 255, (n & 255) / 255);
}

// `shared` are uniforms that all clouds have in common.
function pointMaterial(shared, own) {
    return new THREE.ShaderMaterial({
        vertexShader: POINT_VERTEX,
        fragmentShader: POINT_FRAGMENT,
        uniforms: Object.assign({}, shared, {
            size: { value: own.size },
            bias: { value: own.bias },
            colour: { value: own.colour },
            mode: { value: 0 },
        }),
    });
}

function discMaterial(shared, bias) {
    return new THREE.ShaderMaterial({
        vertexShader: DISC_VERTEX,
        fragmentShader: DISC_FRAGMENT,
        side: THREE.DoubleSide,
        uniforms: { cut: shared.cut, bias: { value: bias } },
    });
}

function lightMaterial(shared) {
    return new THREE.ShaderMaterial({
        vertexShader: LIGHT_VERTEX,
        fragmentShader: LIGHT_FRAGMENT,
        depthTest: false,
        depthWrite: false,
        uniforms: {
            picture: { value: null },
            depth: { value: null },
            pixel: { value: new THREE.Vector2() },
            near: { value: 0.1 },
            far: { value: 1000 },
            strength: { value: 170 },
            darkest: shared.darkest,
            background: shared.background,
        },
    });
}
