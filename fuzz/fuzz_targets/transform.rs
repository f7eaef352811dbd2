//! Any bytes read as a transform.

#![no_main]

use libfuzzer_sys::fuzz_target;
use winze_io::read_transform_bytes;

fuzz_target!(|bytes: &[u8]| {
    match read_transform_bytes(bytes) {
        Ok(pose) => {
            let m = pose.to_matrix();
            assert!(m.iter().flatten().all(|v| v.is_finite()));
            let [x, y, z] = [m[0], m[1], m[2]].map(|[a, b, c, _]| [a, b, c]);
            let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            for (a, b, expected) in [
                (x, x, 1.0),
                (y, y, 1.0),
                (z, z, 1.0),
                (x, y, 0.0),
                (y, z, 0.0),
                (z, x, 0.0),
            ] {
                assert!((dot(a, b) - expected).abs() < 1e-9, "not a rotation: {m:?}");
            }
            let cross = [
                x[1] * y[2] - x[2] * y[1],
                x[2] * y[0] - x[0] * y[2],
                x[0] * y[1] - x[1] * y[0],
            ];
            assert!(dot(cross, z) > 0.0, "a reflection: {m:?}");
        }
        Err(error) => {
            let text = error.to_string();
            assert!(
                !text.chars().any(char::is_control),
                "not printable: {text:?}"
            );
        }
    }
});
