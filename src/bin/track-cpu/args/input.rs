//! How frames are read.

use track_cpu::source::{OnBadFrame, PixelFormat, RawFormat};

use super::values::{on_bad_frame, pixel_format, size};

/// The layout of headerless frames.
#[derive(Debug, clap::Args)]
pub struct RawArgs {
    /// Size of headerless frames.
    #[arg(long, value_name = "WxH", value_parser = size, requires = "pix")]
    raw: Option<(usize, usize)>,
    #[doc = "The pixel format."]
    #[arg(
        long,
        value_name = "FORMAT",
        value_parser = pixel_format,
        requires = "raw",
        help = pix_help()
    )]
    pix: Option<PixelFormat>,
}

impl RawArgs {
    /// The headerless format, if one was given.
    pub fn format(&self) -> Option<RawFormat> {
        let ((width, height), pixels) = self.raw.zip(self.pix)?;
        Some(RawFormat {
            width,
            height,
            pixels,
        })
    }
}

/// The help of every option that names a pixel format.
pub fn pix_help() -> String {
    let names = PixelFormat::NAMES.map(|(name, _)| name).join(", ");
    format!("Pixel format of headerless frames: {names}")
}

/// What happens at a frame that cannot be read.
#[derive(Debug, clap::Args)]
pub struct BadFrameArg {
    /// At a frame that cannot be read: stop; skip it; or hold the last box, which is its line then.
    /// Held and skipped frames are named and counted on standard error, and the exit code is 8.
    #[arg(long, value_name = "HOW", default_value = "hold", value_parser = on_bad_frame)]
    pub on_bad_frame: OnBadFrame,
}
