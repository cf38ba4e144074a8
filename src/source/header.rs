//! The text headers of self-describing streams: y4m and PPM.

use std::io::Read;

use super::pixels::{PixelFormat, RawFormat};
use kernels::pixels::LumaRange;

/// Longest header line accepted, in bytes.
const MAX_LINE: usize = 4096;

/// How one frame of a stream is laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) raw: RawFormat,
    pub(super) range: LumaRange,
}

/// Reads up to and including the next newline; `None` at the end of the stream.
pub(super) fn read_line(reader: &mut impl Read) -> Result<Option<String>, String> {
    let mut line = Vec::new();
    let mut byte = [0];
    loop {
        match reader.read_exact(&mut byte) {
            Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                if line.is_empty() {
                    return Ok(None);
                }
                let found = line.len();
                return Err(format!(
                    "the header ends after {found} bytes, expected a newline"
                ));
            }
            Err(error) => return Err(error.to_string()),
            Ok(()) if byte[0] == b'\n' => {
                return Ok(Some(String::from_utf8_lossy(&line).into_owned()));
            }
            Ok(()) if line.len() == MAX_LINE => {
                return Err(format!("a header line of more than {MAX_LINE} bytes"));
            }
            Ok(()) => line.push(byte[0]),
        }
    }
}

/// Parses what follows `YUV4MPEG2` on a y4m stream's first line.
pub(super) fn parse_y4m(parameters: &str) -> Result<Layout, String> {
    let (mut width, mut height) = (None, None);
    let (mut pixels, mut range) = (PixelFormat::Yuv420p, LumaRange::Limited);
    for parameter in parameters.split_ascii_whitespace() {
        let (key, value) = parameter.split_at(parameter.chars().next().map_or(0, char::len_utf8));
        match key {
            "W" => width = Some(side(value)?),
            "H" => height = Some(side(value)?),
            "C" => {
                pixels = match value {
                    "420" | "420jpeg" | "420mpeg2" | "420paldv" => PixelFormat::Yuv420p,
                    "422" => PixelFormat::Yuv422p,
                    "444" => PixelFormat::Yuv444p,
                    "mono" => PixelFormat::Gray,
                    "mono16" => PixelFormat::Gray16Le,
                    _ => {
                        return Err(format!(
                            "y4m color space {value}, expected 8-bit 420, 422, 444 or mono, or \
                             mono16"
                        ));
                    }
                }
            }
            "X" if value == "COLORRANGE=FULL" => range = LumaRange::Full,
            _ => {} // frame rate, interlacing, aspect, comments
        }
    }
    let (Some(width), Some(height)) = (width, height) else {
        return Err("the y4m header lacks W or H".into());
    };
    Ok(Layout {
        raw: RawFormat::new(width, height, pixels),
        range,
    })
}

/// Reads the rest of a PGM or PPM header, from behind `P5` or `P6` up to the byte before the
/// pixels: width, height and the largest value.
pub(super) fn read_pnm(reader: &mut impl Read) -> Result<[usize; 3], String> {
    let mut numbers = [0; 3];
    let mut length = 0; // of all blanks, comments and digits
    for number in &mut numbers {
        let mut digits = String::new();
        loop {
            let mut byte = [0];
            reader
                .read_exact(&mut byte)
                .map_err(|_| "the PPM header is cut short".to_string())?;
            length += 1;
            match byte[0] {
                _ if length > MAX_LINE => {
                    return Err(format!("a PPM header of more than {MAX_LINE} bytes"));
                }
                b'#' if digits.is_empty() => {
                    read_line(reader)?;
                }
                c if c.is_ascii_digit() => digits.push(char::from(c)),
                c if c.is_ascii_whitespace() && digits.is_empty() => {}
                c if c.is_ascii_whitespace() => break,
                c => return Err(format!("byte {c:#04x} in the PPM header, expected numbers")),
            }
        }
        *number = side(&digits)?;
    }
    Ok(numbers)
}

/// Reads the rest of a PPM header of a stream: what follows `P6`.
pub(super) fn read_ppm(reader: &mut impl Read) -> Result<Layout, String> {
    let [width, height, largest] = read_pnm(reader)?;
    if largest != 255 {
        return Err(format!("PPM maximum {largest}, expected 255"));
    }
    Ok(Layout {
        raw: RawFormat::new(width, height, PixelFormat::Rgb24),
        range: LumaRange::Full,
    })
}

fn side(text: &str) -> Result<usize, String> {
    text.parse()
        .map_err(|_| format!("{text:?} in the header, expected a number of pixels"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn y4m_header_gives_size_and_format_or_names_what_is_wrong() {
        for (header, expected) in [
            (
                " W640 H360 F30:1 Ip A1:1 C420jpeg XYSCSS=420JPEG",
                Ok((640, 360, PixelFormat::Yuv420p)),
            ),
            (" H2 W4", Ok((4, 2, PixelFormat::Yuv420p))),
            (" W4 H2 Cmono", Ok((4, 2, PixelFormat::Gray))),
            (
                " W4 H2 Cmono16 XYSCSS=GRAY16",
                Ok((4, 2, PixelFormat::Gray16Le)),
            ),
            (" W4 H2 C422", Ok((4, 2, PixelFormat::Yuv422p))),
            (" W4 H2 C444", Ok((4, 2, PixelFormat::Yuv444p))),
            (" W4 H2 C420p10", Err("420p10")),
            (" W4 H2 C444alpha", Err("444alpha")),
            (" W4", Err("lacks W or H")),
            (" W-4 H2", Err("\"-4\"")),
            (" W99999999999999999999999 H2", Err("99999")),
            (" Wé H2", Err("é")),
            (" é", Err("lacks")),
        ] {
            match (parse_y4m(header), expected) {
                (Ok(found), Ok((width, height, pixels))) => {
                    assert_eq!(found.raw, RawFormat::new(width, height, pixels), "{header}");
                }
                (Err(message), Err(part)) => assert!(message.contains(part), "{header}: {message}"),
                (found, _) => panic!("{header}: {found:?}"),
            }
        }
        assert_eq!(
            parse_y4m(" W4 H2 XCOLORRANGE=FULL").unwrap().range,
            LumaRange::Full
        );
    }

    #[test]
    fn ppm_header_gives_the_size_or_names_what_is_wrong() {
        for (header, expected) in [
            ("\n640 360\n255\n", Ok((640, 360))),
            (" # made by hand\n 1\t2 # two\n255 ", Ok((1, 2))),
            ("\n640 360\n65535\n", Err("65535")),
            ("\n640 x\n255\n", Err("0x78")),
            ("\n640", Err("cut short")),
            ("\n99999999999999999999999 1 255\n", Err("99999")),
        ] {
            match (read_ppm(&mut header.as_bytes()), expected) {
                (Ok(found), Ok(size)) => {
                    assert_eq!((found.raw.width, found.raw.height), size, "{header}")
                }
                (Err(message), Err(part)) => assert!(message.contains(part), "{header}: {message}"),
                (found, _) => panic!("{header}: {found:?}"),
            }
        }
        let endless = " ".repeat(MAX_LINE + 1);
        assert!(
            read_ppm(&mut endless.as_bytes())
                .unwrap_err()
                .contains("more than")
        );
    }

    #[test]
    fn header_line_without_end_is_refused() {
        assert_eq!(
            read_line(&mut &b"FRAME\nx"[..]).unwrap().as_deref(),
            Some("FRAME")
        );
        assert_eq!(read_line(&mut &b""[..]).unwrap(), None);
        assert!(
            read_line(&mut &b"FRA"[..])
                .unwrap_err()
                .contains("after 3 bytes")
        );
        assert!(
            read_line(&mut &vec![b'x'; MAX_LINE + 1][..])
                .unwrap_err()
                .contains("more than")
        );
    }
}
