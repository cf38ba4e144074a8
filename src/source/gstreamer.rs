//! The user's own GStreamer as source: `gst-launch-1.0` runs a pipeline and writes y4m into a pipe.

use std::ffi::OsStr;
use std::process::Command;

use super::child;

/// The program that runs pipelines.
pub(super) const PROGRAM: &str = "gst-launch-1.0";

/// The command line that runs the elements of a pipeline, separated by `!`, into our pipe.
pub(super) fn command(program: &OsStr, pipeline: &str) -> Command {
    let mut command = child::bound_command(program);
    command.arg("-q");
    // Words are split as a shell splits them without quotes; gst-launch joins them again.
    command.args(pipeline.split_whitespace());
    // A queue of one frame that drops: a camera must never wait for its reader.
    command.args("! queue leaky=downstream max-size-buffers=1 max-size-bytes=0".split(' '));
    // y4menc writes the padding of a buffer as if it were picture. A conversion leaves none, and of
    // two to different formats at least one takes place.
    command.args("! videoconvert ! video/x-raw,format=YV12".split(' '));
    command.args("! videoconvert ! video/x-raw,format=I420 ! y4menc ! fdsink fd=1".split(' '));
    command
}
