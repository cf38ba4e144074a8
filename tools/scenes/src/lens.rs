//! Effects of the camera on the picture: motion blur and sensor noise.

use std::sync::OnceLock;

use crate::math::lerp_packed;
use crate::rng::{Rng, hash};

/// Pixels in the table of noise; a power of two.
const DEVIATES: usize = 1 << 14;
/// Pixels that take their noise from one stretch of the table.
const STRETCH: usize = 256;

/// Noise for RGB pixels with standard deviation 32: mostly of the light, some of each color.
fn deviates() -> &'static [i8] {
    static TABLE: OnceLock<Vec<i8>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut rng = Rng::new(0, 77);
        let mut deviate = || (0..12).map(|_| rng.unit()).sum::<f32>() - 6.0;
        let mut table = Vec::with_capacity(3 * (DEVIATES + STRETCH));
        for _ in 0..DEVIATES + STRETCH {
            let light = 0.83 * deviate();
            table.extend(
                [0; 3].map(|_: i32| (32.0 * (light + 0.55 * deviate())).clamp(-127.0, 127.0) as i8),
            );
        }
        table
    })
}

/// Packed pixels to RGB bytes, smeared along `smear` (pixels) and with noise of the given standard
/// deviation.
pub(crate) fn develop(
    pixels: &[u32],
    width: usize,
    smear: (f32, f32),
    noise: f32,
    seed: u64,
    index: u64,
    out: &mut [u8],
) {
    let height = pixels.len() / width.max(1);
    let long = (smear.0 * smear.0 + smear.1 * smear.1).sqrt();
    let clamp = |v: f32| v.round().clamp(-40.0, 40.0) as i32;
    let near = (clamp(smear.0 / 6.0), clamp(smear.1 / 6.0));
    let far = (clamp(smear.0 / 2.0), clamp(smear.1 / 2.0));
    let gain = (noise * 8.0) as i32;
    let table: Vec<i8> = match gain {
        0 => Vec::new(),
        _ => deviates()
            .iter()
            .map(|&d| ((i32::from(d) * gain) >> 8).clamp(-127, 127) as i8)
            .collect(),
    };
    let mut line = vec![0u32; width];
    for (y, (row, bytes)) in pixels
        .chunks_exact(width)
        .zip(out.chunks_exact_mut(3 * width))
        .enumerate()
    {
        let source = if long < 1.2 {
            row
        } else {
            // The mean of four samples along the smear.
            let from = |d: (i32, i32), sign: i32| {
                let j = (y as i32 + sign * d.1).clamp(0, height as i32 - 1) as usize;
                (&pixels[j * width..][..width], sign * d.0)
            };
            let taps = [from(far, -1), from(near, -1), from(near, 1), from(far, 1)];
            let last = width as i32 - 1;
            for (x, pixel) in line.iter_mut().enumerate() {
                let tap = |k: usize| taps[k].0[(x as i32 + taps[k].1).clamp(0, last) as usize];
                *pixel = lerp_packed(
                    lerp_packed(tap(0), tap(1), 128),
                    lerp_packed(tap(2), tap(3), 128),
                    128,
                );
            }
            &line
        };
        for (&c, b) in source.iter().zip(bytes.chunks_exact_mut(3)) {
            b.copy_from_slice(&c.to_le_bytes()[..3]);
        }
        if gain == 0 {
            continue;
        }
        for (block, bytes) in bytes.chunks_mut(3 * STRETCH).enumerate() {
            let key = hash(
                y as i32,
                (index as i32) << 6 ^ block as i32,
                seed as u32 ^ (seed >> 32) as u32,
            );
            let noise = &table[3 * (key as usize & (DEVIATES - 1))..][..bytes.len()];
            for (b, &n) in bytes.iter_mut().zip(noise) {
                *b = (i16::from(*b) + i16::from(n)).clamp(0, 255) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lens_without_blur_and_noise_keeps_the_pixels() {
        let mut out = [0; 6];
        develop(
            &[0x0003_0201, 0x0006_0504],
            2,
            (0.0, 0.0),
            0.0,
            1,
            1,
            &mut out,
        );
        assert_eq!(out, [1, 2, 3, 4, 5, 6]);
    }

    #[test]
    fn noise_has_the_given_deviation() {
        let pixels = vec![0x0080_8080; 512 * 64];
        let mut out = vec![0; 3 * pixels.len()];
        develop(&pixels, 512, (0.0, 0.0), 4.0, 9, 3, &mut out);
        let n = out.len() as f64;
        let mean = out.iter().map(|&b| f64::from(b)).sum::<f64>() / n;
        let var = out
            .iter()
            .map(|&b| (f64::from(b) - mean).powi(2))
            .sum::<f64>()
            / n;
        assert!((mean - 128.0).abs() < 1.0, "{mean}");
        assert!((2.8..5.2).contains(&var.sqrt()), "{}", var.sqrt());
    }

    #[test]
    fn blur_spreads_a_point_along_the_smear_and_keeps_its_light() {
        let mut pixels = vec![0; 41 * 41];
        pixels[20 * 41 + 20] = 0x0040_4040 * 3;
        let mut out = vec![0; 3 * pixels.len()];
        develop(&pixels, 41, (12.0, 0.0), 0.0, 1, 1, &mut out);
        let lit: Vec<usize> = (0..41).filter(|x| out[3 * (20 * 41 + x)] > 0).collect();
        assert_eq!(lit, [14, 18, 22, 26]);
    }
}
