//! What the tests of several crates share. Other crates name it under `[dev-dependencies]` only.
//!
//! | need | item |
//! |---|---|
//! | values that look random and are the same on every run | [`noise`] |
//! | a folder that disappears with the test | [`Folder`] |
//! | a video whose true boxes are known | [`MovingSquare`] |
//! | comparison of floats | [`assert_close`] |
//! | reference data that a clone does not have | [`shared`] |
//!
//! ```
//! use testing::{Folder, MovingSquare};
//!
//! let folder = Folder::new("example");
//! let boxes = folder.write("a/groundtruth.txt", "8,6,12,12\n");
//! assert!(boxes.is_file());
//!
//! let video = MovingSquare::default();
//! assert_eq!(video.frame(3).len(), 3 * video.width * video.height);
//! ```

#![forbid(unsafe_code)]

mod folder;
mod square;

pub use folder::Folder;
pub use square::MovingSquare;

use std::path::PathBuf;

/// `n` values in `[-1, 1)` that look random and depend on `seed` alone.
pub fn noise(n: usize, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut values = Vec::with_capacity(n);
    for _ in 0..n {
        // Marsaglia's xorshift64.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        values.push((state >> 40) as f32 / (1u64 << 23) as f32 - 1.0);
    }
    values
}

/// Asserts that every value is within `tolerance` times the RMS of `expected` of its twin.
///
/// `what` names the comparison in the panic message.
pub fn assert_close(found: &[f32], expected: &[f64], tolerance: f64, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}: length");
    let squares: f64 = expected.iter().map(|value| value * value).sum();
    let rms = (squares / expected.len().max(1) as f64).sqrt();
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*f) - e).abs();
        assert!(
            error <= tolerance * rms.max(1e-6),
            "{what}: [{i}] is {f}, expected {e}"
        );
    }
}

/// `path` within the reference data, or `None` after printing that the test is skipped.
///
/// The reference data lie in `$TRACK_CPU_SHARED`, or in `../shared` beside the repository.
pub fn shared(path: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let root = std::env::var_os("TRACK_CPU_SHARED").map_or(beside, PathBuf::from);
    let found = root.join(path);
    if found.exists() {
        return Some(found);
    }
    eprintln!(
        "SKIPPED: {} is not here (set TRACK_CPU_SHARED to the reference data)",
        found.display()
    );
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_of_one_seed_repeats_and_stays_in_range() {
        let first = noise(1000, 7);

        let again = noise(1000, 7);

        assert_eq!(first, again);
        assert_ne!(first, noise(1000, 8));
        assert!(first.iter().all(|v| (-1.0..1.0).contains(v)));
    }

    #[test]
    #[should_panic(expected = "sum: [1] is 2.5, expected 2")]
    fn assert_close_outside_tolerance_panics_with_index() {
        assert_close(&[1.0, 2.5], &[1.0, 2.0], 1e-3, "sum");
    }
}
