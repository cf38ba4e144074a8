//! A picture as text.

use crate::base64;
use crate::error::Error;
use std::path::PathBuf;

/// Largest side of a picture in memory.
const MAX_SIDE: usize = 1 << 15;

/// A picture, not yet decoded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Picture {
    /// `file://PATH`: a file, absolute.
    Path(PathBuf),
    /// `image:W;H;FORMAT;BASE64`: `height` rows of `width` pixels without gaps.
    Memory {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// What a pixel is.
        pixels: Pixels,
        /// The bytes of all pixels.
        data: Vec<u8>,
    },
    /// `data:TYPE;BASE64`: the bytes of a picture file. `data:TYPE;base64,BASE64` is the same.
    Encoded(Vec<u8>),
}

/// What a pixel in memory is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Three bytes: red, green, blue.
    Rgb,
    /// One byte.
    Gray8,
    /// Two bytes, the lower one first.
    Gray16,
}

impl Pixels {
    /// Bytes of one.
    pub fn bytes(self) -> usize {
        match self {
            Pixels::Rgb => 3,
            Pixels::Gray8 => 1,
            Pixels::Gray16 => 2,
        }
    }

    fn from_name(name: &str) -> Option<Pixels> {
        match name {
            "rgb" => Some(Pixels::Rgb),
            "gray8" => Some(Pixels::Gray8),
            "gray16" => Some(Pixels::Gray16),
            _ => None,
        }
    }
}

impl Picture {
    /// The picture that a text describes.
    ///
    /// # Errors
    /// If it is neither a file, pixels in memory nor an encoded picture, or its bytes are not as
    /// many as its size says.
    pub fn parse(text: &str) -> Result<Picture, Error> {
        let failure = |expected| Error::part("image", expected, text);
        if let Some(path) = text.strip_prefix("file://") {
            let path = PathBuf::from(path);
            return path
                .is_absolute()
                .then_some(Picture::Path(path))
                .ok_or(failure("file:// and an absolute path"));
        }
        if let Some(rest) = text.strip_prefix("image:") {
            return memory(rest).ok_or(failure(
                "image:WIDTH;HEIGHT;rgb, gray8 or gray16;BASE64 of as many pixels",
            ));
        }
        if let Some(rest) = text.strip_prefix("data:") {
            return encoded(rest).ok_or(failure("data:TYPE;BASE64"));
        }
        Err(failure("file://, image: or data:"))
    }
}

fn memory(text: &str) -> Option<Picture> {
    let mut parts = text.splitn(4, ';');
    let mut side = || {
        parts
            .next()?
            .parse()
            .ok()
            .filter(|side| (1..=MAX_SIDE).contains(side))
    };
    let (width, height) = (side()?, side()?);
    let pixels = Pixels::from_name(parts.next()?)?;
    let data = base64::decode(parts.next()?)?;
    (data.len() == width * height * pixels.bytes()).then_some(Picture::Memory {
        width,
        height,
        pixels,
        data,
    })
}

fn encoded(text: &str) -> Option<Picture> {
    let (_, rest) = text.split_once(';')?;
    let rest = rest
        .strip_prefix("base64")
        .and_then(|rest| rest.strip_prefix([';', ',']))
        .unwrap_or(rest);
    base64::decode(rest).map(Picture::Encoded)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form() {
        let path = Picture::Path("/tmp/a b=c/1.jpg".into());
        assert_eq!(Picture::parse("file:///tmp/a b=c/1.jpg").unwrap(), path);
        let Picture::Memory {
            width: 3,
            height: 2,
            pixels: Pixels::Rgb,
            data,
        } = Picture::parse("image:3;2;rgb;AAECAwQFBgcICQoLDA0ODxAR").unwrap()
        else {
            panic!("not in memory")
        };
        assert_eq!(data, (0..18).collect::<Vec<u8>>());
        let gray = Picture::parse("image:3;2;gray8;AAMGCQwP").unwrap();
        assert!(matches!(
            gray,
            Picture::Memory {
                pixels: Pixels::Gray8,
                ..
            }
        ));
        for text in [
            "data:image/jpeg;/9j/4Gg=",
            "data:image/jpeg;base64;/9j/4Gg=",
            "data:image/jpeg;base64,/9j/4Gg=",
        ] {
            assert_eq!(
                Picture::parse(text).unwrap(),
                Picture::Encoded(vec![0xff, 0xd8, 0xff, 0xe0, 0x68])
            );
        }
    }

    #[test]
    fn what_is_no_picture() {
        for text in [
            "",
            "/tmp/1.jpg",
            "file://1.jpg",
            "file://-",
            "http://host/1.jpg",
            "image:",
            "image:3;2;rgb;AAEC",
            "image:3;2;bgr;AAECAwQFBgcICQoLDA0ODxAR",
            "image:0;2;rgb;",
            "image:3;99999;rgb;AAEC",
            "image:99999999999999999999;2;rgb;AAEC",
            "image:3;2;rgb;****",
            "data:image/jpeg",
            "data:image/jpeg;base64,*",
        ] {
            assert!(Picture::parse(text).is_err(), "{text}");
        }
    }
}
