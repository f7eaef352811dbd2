//! Trajectories as text, in the form of the TUM RGB-D benchmark: `seconds x y z qx qy qz qw` a line.

use std::fmt::Write as _;
use std::path::Path;

use winze::Pose;

use crate::atomic;
use crate::error::Result;

/// Writes the poses that a sensor had at given times; they take points of the sensor to the frame that
/// `comment` names.
///
/// # Errors
/// Where the file cannot be written.
pub fn write_trajectory(path: &Path, comment: &str, poses: &[(f64, Pose)]) -> Result<()> {
    atomic::write_bytes(path, format(comment, poses).as_bytes())
}

fn format(comment: &str, poses: &[(f64, Pose)]) -> String {
    let mut text = format!(
        "# {}\n# seconds x y z qx qy qz qw\n",
        comment.replace('\n', " ")
    );
    for (seconds, pose) in poses {
        let [x, y, z] = pose.translation();
        let [qx, qy, qz, qw] = quaternion(pose);
        let _ = writeln!(
            text,
            "{seconds:.6} {x:.9} {y:.9} {z:.9} {qx:.12} {qy:.12} {qz:.12} {qw:.12}"
        );
    }
    text
}

/// The unit quaternion of a pose's rotation, imaginary parts first, `w` not negative.
fn quaternion(pose: &Pose) -> [f64; 4] {
    let [_, _, _, a, b, c] = pose.log();
    let angle = (a * a + b * b + c * c).sqrt();
    // sin(angle/2)/angle, by its series where the angle is tiny.
    let scale = if angle < 1e-8 {
        0.5
    } else {
        libm::sin(0.5 * angle) / angle
    };
    [a * scale, b * scale, c * scale, libm::cos(0.5 * angle)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_and_none() {
        let quarter =
            Pose::from_yaw_pitch_roll(std::f64::consts::FRAC_PI_2, 0.0, 0.0, [1.0, 2.0, 3.0]);
        let text = format(
            "map_from_sensor",
            &[(0.5, quarter), (1.0, Pose::identity())],
        );
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "# map_from_sensor");
        let numbers: Vec<f64> = lines[2].split(' ').map(|t| t.parse().unwrap()).collect();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let expected = [0.5, 1.0, 2.0, 3.0, 0.0, 0.0, half, half];
        for (a, b) in numbers.iter().zip(expected) {
            assert!((a - b).abs() < 1e-9, "{numbers:?}");
        }
        assert!(lines[3].ends_with(" 1.000000000000"), "{}", lines[3]);
    }
}
