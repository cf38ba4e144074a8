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
    /// How programs that read it are told more.
    #[command(flatten)]
    more: ReadArgs,
}

/// More about how frames are read.
#[derive(Clone, Debug, clap::Args)]
pub struct ReadArgs {
    /// Bytes from row to row of headerless frames, where rows are padded; planes of half the width
    /// have half of it.
    #[arg(long, value_name = "BYTES", requires = "raw")]
    stride: Option<usize>,
    /// Options of ffmpeg for the input, separated by blanks, such as "-rtsp_transport udp".
    #[arg(
        long,
        value_name = "ARGS",
        allow_hyphen_values = true,
        default_value = "",
        hide_default_value = true
    )]
    ffmpeg_args: String,
}

impl ReadArgs {
    /// Frames of this size, if their layout was given.
    pub fn raw(
        &self,
        size: Option<(usize, usize)>,
        pixels: Option<PixelFormat>,
    ) -> Option<RawFormat> {
        let ((width, height), pixels) = size.zip(pixels)?;
        Some(RawFormat {
            stride: self.stride,
            ..RawFormat::new(width, height, pixels)
        })
    }

    /// Options of ffmpeg, one by one.
    pub fn ffmpeg(&self) -> Vec<String> {
        self.ffmpeg_args
            .split_whitespace()
            .map(str::to_string)
            .collect()
    }
}

impl RawArgs {
    /// The headerless format, if one was given.
    pub fn format(&self) -> Option<RawFormat> {
        self.more.raw(self.raw, self.pix)
    }

    /// Options of ffmpeg, one by one.
    pub fn ffmpeg_args(&self) -> Vec<String> {
        self.more.ffmpeg()
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
