//! Degradations of square BGR crops, `[side, side, 3]`: blur, noise, JPEG, low resolution.

use super::warp::blend;
use crate::rng::Rng;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};

/// A tap of a filter: where it looks, in pixels, and its weight of 65536.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Tap {
    dx: i32,
    dy: i32,
    weight: u32,
}

/// Gaussian blur of a standard deviation in pixels.
pub fn blur(image: &[u8], side: usize, sigma: f32) -> Vec<u8> {
    let reach = (2.5 * sigma).ceil() as i32;
    let weights: Vec<_> = (-reach..=reach)
        .map(|d| (-0.5 * (d as f32 / sigma).powi(2)).exp())
        .collect();
    let along =
        |place: &dyn Fn(i32) -> (i32, i32)| taps((-reach..=reach).map(place).zip(weights.clone()));
    let across = filter(image, side, &along(&|d| (d, 0)));
    filter(&across, side, &along(&|d| (0, d)))
}

/// Blur along a line of `length` pixels at an angle in radians.
pub fn motion_blur(image: &[u8], side: usize, length: usize, angle: f32) -> Vec<u8> {
    let (sin, cos) = angle.sin_cos();
    let middle = (length as f32 - 1.0) / 2.0;
    let place = |i: usize| {
        let along = i as f32 - middle;
        ((along * cos).round() as i32, (along * sin).round() as i32)
    };
    filter(image, side, &taps((0..length).map(|i| (place(i), 1.0))))
}

/// Taps whose weights sum to 65536.
fn taps(places: impl Iterator<Item = ((i32, i32), f32)>) -> Vec<Tap> {
    let places: Vec<_> = places.collect();
    let total: f32 = places.iter().map(|(_, weight)| weight).sum();
    let mut left = 65536;
    let mut taps = Vec::with_capacity(places.len());
    for ((dx, dy), weight) in places {
        let weight = ((weight / total * 65536.0).round() as u32).min(left);
        left -= weight;
        taps.push(Tap { dx, dy, weight });
    }
    let middle = taps.len() / 2;
    taps[middle].weight += left;
    taps
}

/// Weighted sum of shifted copies. Beyond the edge the outermost pixel is repeated.
fn filter(image: &[u8], side: usize, taps: &[Tap]) -> Vec<u8> {
    let row = side * 3;
    let mut out = vec![0; image.len()];
    let mut sums = vec![0u32; row];
    for (y, out) in out.chunks_exact_mut(row).enumerate() {
        sums.fill(32768);
        for tap in taps {
            let from = (y as i32 + tap.dy).clamp(0, side as i32 - 1) as usize;
            let from = &image[from * row..][..row];
            let shift = (tap.dx.unsigned_abs() as usize).min(side - 1) * 3;
            // Split into the part with pixels of its own and the part beyond the edge.
            let ((inner, edge), (source, last)) = if tap.dx >= 0 {
                (
                    sums.split_at_mut(row - shift),
                    (&from[shift..], &from[row - 3..]),
                )
            } else {
                let (edge, inner) = sums.split_at_mut(shift);
                ((inner, edge), (&from[..row - shift], &from[..3]))
            };
            for (sum, value) in inner.iter_mut().zip(source) {
                *sum += tap.weight * u32::from(*value);
            }
            for (sum, value) in edge.iter_mut().zip(last.iter().cycle()) {
                *sum += tap.weight * u32::from(*value);
            }
        }
        for (out, sum) in out.iter_mut().zip(&sums) {
            *out = (sum >> 16) as u8;
        }
    }
    out
}

/// Adds independent noise of a standard deviation, nearly normal.
pub fn noise(image: &mut [u8], sigma: f32, rng: &mut Rng) {
    // The sum of four uniform bytes has mean 510 and standard deviation 147.8.
    let factor = (sigma / 147.8 * 65536.0) as i32;
    let mut rng = rng.clone();
    for pair in image.chunks_mut(2) {
        let bytes = rng.bits().to_le_bytes();
        for (value, bytes) in pair.iter_mut().zip(bytes.chunks_exact(4)) {
            let sum: i32 = bytes.iter().map(|b| i32::from(*b)).sum();
            *value =
                (i32::from(*value) + (((sum - 510) * factor + 32768) >> 16)).clamp(0, 255) as u8;
        }
    }
}

/// Encodes and decodes as JPEG of a quality from 1 to 100.
///
/// The channels are taken for red, green and blue; the artifacts are of the same kind.
pub fn jpeg(image: &[u8], side: usize, quality: u8) -> Vec<u8> {
    let mut file = Vec::new();
    let size = side as u32;
    let encoded = JpegEncoder::new_with_quality(&mut file, quality).encode(
        image,
        size,
        size,
        ExtendedColorType::Rgb8,
    );
    let decoded = image::load_from_memory_with_format(&file, ImageFormat::Jpeg);
    match (encoded, decoded) {
        (Ok(()), Ok(decoded)) => decoded.into_rgb8().into_raw(),
        _ => image.to_vec(), // memory to memory: cannot fail
    }
}

/// Reduces the resolution by `factor` by block means, then enlarges bilinearly.
pub fn low_resolution(image: &[u8], side: usize, factor: f32) -> Vec<u8> {
    let small_side = ((side as f32 / factor).round() as usize).clamp(2, side);
    let edge = |i: usize| i * side / small_side;
    let mut small = vec![0; small_side * small_side * 3];
    let mut sums = vec![[0u32; 3]; small_side];
    for (j, out) in small.chunks_exact_mut(small_side * 3).enumerate() {
        sums.fill([0; 3]);
        for y in edge(j)..edge(j + 1) {
            let row = &image[y * side * 3..][..side * 3];
            for (i, sum) in sums.iter_mut().enumerate() {
                for pixel in row[edge(i) * 3..edge(i + 1) * 3].chunks_exact(3) {
                    sum[0] += u32::from(pixel[0]);
                    sum[1] += u32::from(pixel[1]);
                    sum[2] += u32::from(pixel[2]);
                }
            }
        }
        for (i, (out, sum)) in out.chunks_exact_mut(3).zip(&sums).enumerate() {
            let count = ((edge(i + 1) - edge(i)) * (edge(j + 1) - edge(j))) as u32;
            for (out, sum) in out.iter_mut().zip(sum) {
                *out = ((sum + count / 2) / count) as u8;
            }
        }
    }
    enlarge(&small, small_side, side)
}

fn enlarge(image: &[u8], small: usize, side: usize) -> Vec<u8> {
    let step = small as f32 / side as f32;
    // Pixel centers map to pixel centers; the outermost ones stay.
    let tap = |i: usize| {
        let x = ((i as f32 + 0.5) * step - 0.5).clamp(0.0, (small - 1) as f32);
        let first = (x as usize).min(small - 2);
        (first, x - first as f32)
    };
    let columns: Vec<_> = (0..side).map(tap).collect();
    let mut out = vec![0; side * side * 3];
    for (row, (j, y)) in out.chunks_exact_mut(side * 3).zip((0..side).map(tap)) {
        let upper = &image[j * small * 3..][..small * 3];
        let lower = &image[(j + 1) * small * 3..][..small * 3];
        for (out, (i, x)) in row.chunks_exact_mut(3).zip(&columns) {
            let (upper, lower) = (&upper[i * 3..][..6], &lower[i * 3..][..6]);
            for channel in 0..3 {
                let taps = [
                    upper[channel],
                    upper[channel + 3],
                    lower[channel],
                    lower[channel + 3],
                ];
                out[channel] = blend(taps, *x, y);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 33;

    fn dot() -> Vec<u8> {
        let mut image = vec![0; SIDE * SIDE * 3];
        image[(16 * SIDE + 16) * 3..][..3].fill(255);
        image
    }

    fn spread(image: &[u8]) -> (f64, f64, f64) {
        let (mut sum, mut xx, mut yy) = (0.0, 0.0, 0.0);
        for (i, pixel) in image.chunks(3).enumerate() {
            let (value, x, y) = (
                f64::from(pixel[1]),
                (i % SIDE) as f64 - 16.0,
                (i / SIDE) as f64 - 16.0,
            );
            sum += value;
            xx += value * x * x;
            yy += value * y * y;
        }
        (sum, (xx / sum).sqrt(), (yy / sum).sqrt())
    }

    #[test]
    fn blur_has_its_deviation() {
        let (sum, x, y) = spread(&blur(&dot(), SIDE, 1.0));
        assert!(
            (sum - 255.0).abs() < 30.0 && (x - 1.0).abs() < 0.1 && (y - 1.0).abs() < 0.1,
            "{sum} {x} {y}"
        );
        let (_, x, y) = spread(&motion_blur(&dot(), SIDE, 9, 0.0));
        assert!((x - 2.58).abs() < 0.05 && y < 1e-9, "{x} {y}");
        let (_, x, y) = spread(&motion_blur(&dot(), SIDE, 9, std::f32::consts::FRAC_PI_2));
        assert!((y - 2.58).abs() < 0.05 && x < 1e-9, "{x} {y}");
    }

    #[test]
    fn filters_keep_constant_images() {
        let image = [7u8, 99, 255].repeat(SIDE * SIDE);
        for out in [
            blur(&image, SIDE, 1.7),
            motion_blur(&image, SIDE, 12, 0.7),
            low_resolution(&image, SIDE, 2.3),
            low_resolution(&image, SIDE, 100.0),
        ] {
            assert_eq!(out, image);
        }
        let gray = vec![128; SIDE * SIDE * 3];
        assert!(jpeg(&gray, SIDE, 30).iter().all(|v| v.abs_diff(128) < 3));
    }

    #[test]
    fn noise_has_its_deviation_and_no_bias() {
        let mut image = vec![128; 90_000];
        noise(&mut image, 6.0, &mut Rng::new(1, 1, 1));
        let n = image.len() as f64;
        let mean = image.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
        let variance = image
            .iter()
            .map(|v| (f64::from(*v) - mean).powi(2))
            .sum::<f64>()
            / n;
        assert!(
            (mean - 128.0).abs() < 0.1 && (variance.sqrt() - 6.0).abs() < 0.15,
            "{mean} {variance}"
        );
    }

    #[test]
    fn low_resolution_loses_detail_but_not_the_mean() {
        let mut rng = Rng::new(4, 4, 4);
        let image: Vec<u8> = (0..SIDE * SIDE * 3).map(|_| rng.bits() as u8).collect();
        let small = low_resolution(&image, SIDE, 3.0);
        let mean = |v: &[u8]| v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64;
        let deviation = |v: &[u8]| {
            v.iter()
                .map(|x| (f64::from(*x) - mean(v)).powi(2))
                .sum::<f64>()
                / v.len() as f64
        };
        assert!((mean(&image) - mean(&small)).abs() < 3.0);
        assert!(deviation(&small) < 0.25 * deviation(&image));
    }
}
