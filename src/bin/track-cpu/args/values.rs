//! Numbers, names, boxes and sizes of the command line.

use std::path::{Path, PathBuf};

use kernels::conv::Algorithm;
use kernels::par::Threads;
use track_cpu::flight::{FRAME_RATES, check_threshold};
use track_cpu::source::{OnBadFrame, PixelFormat};
use track_cpu::{BBox, Cores, Isa, Precision};

/// Most targets that are followed at a time.
#[cfg(feature = "serve")]
pub const MAX_TARGETS: usize = 8;

/// A number of threads.
pub fn threads(text: &str) -> Result<usize, String> {
    number_in(text, 1, Threads::MAX)
}

/// A number of targets.
#[cfg(feature = "serve")]
pub fn targets(text: &str) -> Result<usize, String> {
    number_in(text, 1, MAX_TARGETS)
}

/// Processor cores that this machine has.
pub fn cores(text: &str) -> Result<Cores, String> {
    let cores: Cores = text.parse()?;
    let available = Cores::available();
    // Where the system does not tell its cores, it decides later.
    if available == Cores::ANY || cores.within(available) {
        return Ok(cores);
    }
    Err(format!(
        "expected some of the cores {available}, found {cores}"
    ))
}

/// A share from 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let share = number.filter(|share| (0.0..=1.0).contains(share));
    share.ok_or_else(|| "expected a number from 0 to 1".into())
}

/// A time in minutes.
pub fn minutes(text: &str) -> Result<f64, String> {
    let number = text.parse().ok();
    let minutes = number.filter(|minutes| *minutes > 0.0 && *minutes <= 1440.0);
    minutes.ok_or_else(|| "expected minutes above 0, at most 1440".into())
}

/// A number of frames to render.
pub fn frames(text: &str) -> Result<usize, String> {
    number_in(text, 2, 100_000)
}

fn number_in(text: &str, least: usize, most: usize) -> Result<usize, String> {
    match text.parse() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(format!("expected a whole number from {least} to {most}")),
    }
}

/// The name of an arithmetic.
pub fn precision(text: &str) -> Result<Precision, String> {
    Precision::from_name(text).ok_or_else(|| format!("expected f32 or int8, found '{text}'"))
}

/// The name of a convolution algorithm.
pub fn algorithm(text: &str) -> Result<Algorithm, String> {
    let names = Algorithm::ALL.map(Algorithm::name).join(", ");
    Algorithm::from_name(text).ok_or_else(|| format!("expected one of: {names}"))
}

/// The name of an instruction set of this machine.
pub fn isa(text: &str) -> Result<Isa, String> {
    Isa::from_name(text).map_err(|error| error.to_string())
}

/// The version of the TraX protocol.
pub fn trax_version(text: &str) -> Result<u32, String> {
    let number = text.parse().ok();
    let version = number.filter(|version| [1, 3, 4].contains(version));
    version.ok_or_else(|| "expected 1, 3 or 4".into())
}

/// A box: left, top, width, height in pixels.
pub fn bbox(text: &str) -> Result<BBox, String> {
    let numbers: Option<Vec<f32>> = text
        .split(',')
        .map(|number| number.trim().parse().ok())
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, w, h]) if BBox::new(x, y, w, h).is_finite() => Ok(BBox::new(x, y, w, h)),
        Some(numbers) if numbers.len() != 4 => Err(format!(
            "expected four finite numbers: left,top,width,height; found {} numbers",
            numbers.len()
        )),
        _ => Err("expected four finite numbers: left,top,width,height".into()),
    }
}

/// A folder or film for drawn frames.
pub fn overlay(text: &str) -> Result<PathBuf, String> {
    const OTHERS: [&str; 9] = [
        "avi", "mov", "mkv", "webm", "jpg", "jpeg", "png", "webp", "bmp",
    ];
    let path = PathBuf::from(text);
    let is_other = path
        .extension()
        .is_some_and(|found| OTHERS.iter().any(|other| found.eq_ignore_ascii_case(other)));
    if is_other && !path.is_dir() {
        return Err("expected a folder, a .gif or a .mp4".into());
    }
    Ok(path)
}

/// A contact sheet, a folder or a film for drawn frames.
pub fn drawn(text: &str) -> Result<PathBuf, String> {
    if Path::new(text)
        .extension()
        .is_some_and(|found| found.eq_ignore_ascii_case("png"))
    {
        return Ok(text.into());
    }
    overlay(text).map_err(|_| "expected a .png, a .gif, a .mp4 or a folder".into())
}

/// Width and height in pixels.
pub fn size(text: &str) -> Result<(usize, usize), String> {
    let sides = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT in pixels, such as 640x480".into())
}

/// Frames per second.
pub fn frame_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate| FRAME_RATES.contains(rate));
    let (least, most) = (FRAME_RATES.start(), FRAME_RATES.end());
    rate.ok_or_else(|| format!("expected a number from {least} to {most}"))
}

/// A threshold of flight mode: its name and number.
pub fn threshold(text: &str) -> Result<(String, f64), String> {
    let (name, number) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    let number = number
        .parse()
        .map_err(|_| format!("{name} is {number:?}, expected a number"))?;
    check_threshold(name, number).map_err(|error| error.to_string())?;
    Ok((name.into(), number))
}

/// The name of a pixel format.
pub fn pixel_format(text: &str) -> Result<PixelFormat, String> {
    let names = PixelFormat::NAMES.map(|(name, _)| name).join(", ");
    PixelFormat::from_name(text).ok_or_else(|| format!("expected one of: {names}"))
}

/// The name of a policy for frames that cannot be read.
pub fn on_bad_frame(text: &str) -> Result<OnBadFrame, String> {
    let names = OnBadFrame::NAMES.map(|(name, _)| name).join(", ");
    OnBadFrame::from_name(text).ok_or_else(|| format!("expected one of: {names}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_of_four_finite_numbers_is_parsed() {
        assert_eq!(bbox("1, 2.5,-3,4e1"), Ok(BBox::new(1.0, 2.5, -3.0, 40.0)));
        for text in [
            "",
            "1,2,3",
            "1,2,3,4,5",
            "1,2,3,nan",
            "1,2,inf,4",
            "a,b,c,d",
            "1;2;3;4",
            "1,5;2,5;3,5;4,5",
        ] {
            assert!(bbox(text).is_err(), "{text}");
        }
        assert!(bbox("1,2,3,4,5,6,7,8").unwrap_err().contains("8 numbers"));
    }

    #[test]
    fn size_of_two_whole_numbers_is_parsed() {
        assert_eq!(size("640x360"), Ok((640, 360)));
        for text in ["640", "640x", "x360", "-1x5", "640x360x3", "axb"] {
            assert!(size(text).is_err(), "{text}");
        }
    }
}
