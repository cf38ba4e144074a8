//! The box of `track`, drawn by hand on the web page of `serve`.

use std::process::{Command, Stdio};

use station::FrameBox;
use track_cpu::BBox;
use track_cpu::source::Image;

use super::feed::picture;
use crate::exit::Failure;

/// Shows the first frame until a box is drawn in it that `accept` does not refuse.
///
/// # Errors
/// If the page cannot be served.
pub fn ask(
    first: &Image,
    mut accept: impl FnMut(BBox) -> Result<(), String>,
) -> Result<BBox, Failure> {
    let to_box = |FrameBox { x, y, w, h }: FrameBox| BBox::new(x, y, w, h);
    let accept = |drawn| accept(to_box(drawn));
    let drawn = station::pick::pick(&picture(first.clone()), browse, accept)?;
    Ok(to_box(drawn))
}

/// Opens an address in the browser, where there is a display; the address is also said.
fn browse(url: &str) {
    let displays = ["DISPLAY", "WAYLAND_DISPLAY"];
    if !displays.iter().any(|name| std::env::var_os(name).is_some()) {
        return;
    }
    let mut opener = Command::new("xdg-open");
    opener.arg(url);
    opener
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    if let Ok(mut opener) = opener.spawn() {
        std::thread::spawn(move || opener.wait()); // so that none is left behind
    }
}
