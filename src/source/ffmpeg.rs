//! The user's own `ffmpeg` as decoder: it writes PPM frames into a pipe.
//!
//! PPM, because every frame names its size, and ffmpeg knows the video's color space. Frames keep
//! their order and number: they are stamped 1/25 s apart and asked for at 25 a second, which no
//! version of ffmpeg answers by dropping or repeating any. (`-vsync` is gone since 9.0, and
//! `-fps_mode` is new in 5.1.) Frames of another size are scaled by ffmpeg to that of the first.

use std::ffi::OsStr;
use std::process::Command;

use super::{Input, LIVE_SCHEMES, child};

/// Protocols that a description of RTP streams may lead to.
const RTP_PROTOCOLS: &str = "file,data,udp,rtp,crypto";

/// The command line that decodes the first video stream of `location` to PPM.
///
/// # Errors
/// If the location names an RTP stream wrongly.
pub(super) fn command(program: &OsStr, location: &OsStr, input: &Input) -> Result<Command, String> {
    let mut command = child::bound_command(program);
    command.args(["-nostdin", "-hide_banner", "-loglevel", "error"]);
    let text = location.to_str().unwrap_or_default();
    let rtp = text
        .strip_prefix("rtp:")
        .filter(|rest| !rest.starts_with("//"));
    let is_description = rtp.is_some() || text.ends_with(".sdp");
    let is_live = LIVE_SCHEMES.iter().any(|scheme| text.starts_with(scheme));
    if input.is_live || is_live || is_description {
        // Frames at once, rather than after five seconds of probing the stream.
        command.args(["-fflags", "nobuffer", "-analyzeduration", "1000000"]);
        // Decoding by frames keeps one frame back per thread, which costs 70 to 80 ms.
        command.args(["-flags", "low_delay", "-thread_type", "slice"]);
    }
    if text.starts_with("rtsp://") {
        // UDP loses packets, and whole frames with them.
        command.args(["-rtsp_transport", "tcp"]);
    }
    if is_description {
        command.args(["-f", "sdp", "-protocol_whitelist", RTP_PROTOCOLS]);
    }
    // The user's options come last, since ffmpeg takes the last one of a name.
    command
        .args(["-r", "25"])
        .args(&input.ffmpeg_args)
        .arg("-i");
    match rtp {
        Some(rtp) => {
            let description = base64(description(rtp)?.as_bytes());
            command.arg(format!("data:application/sdp;base64,{description}"))
        }
        None => command.arg(location),
    };
    // A filter is made again where the size changes: it counts on from the decoder's stamp.
    let stamps = "setpts=STARTPTS+N/(25*TB)";
    command.args(["-map", "0:v:0", "-vf", stamps, "-r", "25"]);
    command.args([
        "-f",
        "image2pipe",
        "-c:v",
        "ppm",
        "-pix_fmt",
        "rgb24",
        "pipe:1",
    ]);
    Ok(command)
}

/// The session description of `PORT` or `PORT/CODEC`.
fn description(rtp: &str) -> Result<String, String> {
    let (port, codec) = rtp.split_once('/').unwrap_or((rtp, "h264"));
    let wrong = || format!("expected rtp:PORT or rtp:PORT/h264, h265 or jpeg, found rtp:{rtp}");
    let port: u16 = port.parse().map_err(|_| wrong())?;
    // Payload types: 96 is the first one without a fixed meaning, 26 is JPEG.
    let (payload, name) = match codec {
        "h264" => (96, "H264"),
        "h265" => (96, "H265"),
        "jpeg" => (26, "JPEG"),
        _ => return Err(wrong()),
    };
    let lines = [
        "v=0".to_string(),
        "o=- 0 0 IN IP4 127.0.0.1".into(),
        "s=track-cpu".into(),
        "c=IN IP4 0.0.0.0".into(),
        "t=0 0".into(),
        format!("m=video {port} RTP/AVP {payload}"),
        format!("a=rtpmap:{payload} {name}/90000"),
    ];
    Ok(lines.join("\r\n") + "\r\n")
}

/// Bytes in base64, the one form in which ffmpeg takes data on its command line.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::new();
    for chunk in bytes.chunks(3) {
        let byte = |index: usize| u32::from(chunk.get(index).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let value = (bits >> (18 - 6 * digit)) & 63;
            // Three bytes have four digits, two have three, one has two.
            let is_present = digit <= chunk.len();
            text.push(if is_present {
                char::from(DIGITS[value as usize])
            } else {
                '='
            });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The arguments behind ffmpeg's own name.
    fn arguments(input: &Input) -> Result<Vec<String>, String> {
        let command = command(OsStr::new("ffmpeg"), input.location.as_os_str(), input)?;
        let all: Vec<String> = command
            .get_args()
            .map(|argument| argument.to_string_lossy().into_owned())
            .collect();
        let start = all.iter().position(|argument| argument == "-nostdin");
        Ok(all[start.unwrap()..].to_vec())
    }

    #[test]
    fn stream_is_decoded_without_delay_and_a_file_as_it_is() {
        for (location, is_live) in [
            ("rtsp://a/b", true),
            ("rtp:5600", true),
            ("camera.sdp", true),
            ("clip.mp4", false),
            ("http://a/film.mp4", false),
        ] {
            let found = arguments(&Input::new(location)).unwrap();

            let has_flag = found.iter().any(|argument| argument == "low_delay");
            assert_eq!(has_flag, is_live, "{location}");
        }
        let input = Input {
            is_live: true,
            ..Input::new("http://a/b")
        };
        assert!(arguments(&input).unwrap().contains(&"low_delay".into()));
    }

    #[test]
    fn own_arguments_stand_last_before_the_input() {
        let input = Input {
            ffmpeg_args: vec!["-rtsp_transport".into(), "udp".into()],
            ..Input::new("rtsp://a/b")
        };

        let found = arguments(&input).unwrap();

        let at = found.iter().position(|argument| argument == "-i").unwrap();
        assert_eq!(found[at - 2..at], ["-rtsp_transport", "udp"]);
    }

    #[test]
    fn base64_has_the_digits_of_its_definition() {
        // RFC 4648, section 10.
        for (bytes, text) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn rtp_port_is_described_or_refused() {
        let described = description("5600").unwrap();
        assert!(
            described.contains("m=video 5600 RTP/AVP 96\r\n"),
            "{described}"
        );
        assert!(description("5600/h265").unwrap().contains("H265"));
        for wrong in ["", "x", "70000", "5600/vp9", "5600/"] {
            let message = description(wrong).unwrap_err();
            assert!(message.contains("expected rtp:PORT"), "{message}");
        }
    }
}
