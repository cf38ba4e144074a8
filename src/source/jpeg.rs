//! Whole JPEGs are told from ones that are cut short, with or without an end marker.
//!
//! A decoder fills what is missing with gray and says nothing. A file without an end marker, as
//! some cameras write it, is whole if its scans cover every coefficient of every component, and if
//! bytes appended to it change no pixel: a picture that lacks a block would take them for that
//! block. A file with an end marker lacks something if restart markers are missing; without any,
//! bytes put in front of the end must change no pixel.

const START_OF_SCAN: u8 = 0xda;
const RESTART_INTERVAL: u8 = 0xdd;
const END_OF_IMAGE: [u8; 2] = [0xff, 0xd9];

/// What is appended to a file without an end: two texts that no Huffman table decodes to the same.
const TAILS: [u8; 2] = [0x00, 0x55];
/// Bytes of a tail: enough for the blocks of several rows.
const TAIL_BYTES: usize = 4096;

/// What stands before the end marker behind the headers, which may contain a whole small JPEG;
/// `None` without such a marker.
pub(super) fn before_end(jpeg: &[u8]) -> Option<&[u8]> {
    let scan = Segments::of(jpeg).find(|segment| segment.marker == START_OF_SCAN)?;
    let length = jpeg[scan.at..]
        .windows(2)
        .position(|pair| pair == END_OF_IMAGE)?;
    Some(&jpeg[..scan.at + length])
}

/// A file without its end marker, with two different tails and an end marker; `None` if it lacks a
/// whole scan.
///
/// The picture is whole if both decode to the same pixels.
pub(super) fn with_tails(jpeg: &[u8]) -> Option<[Vec<u8>; 2]> {
    if !has_every_scan(jpeg) {
        return None;
    }
    let body = jpeg.strip_suffix(&[0xff]).unwrap_or(jpeg); // half an end marker
    Some(TAILS.map(|byte| [body, &[byte; TAIL_BYTES], &END_OF_IMAGE].concat()))
}

/// Checks that no restart marker is missing, in files that have them.
///
/// # Errors
/// With a reason if one is missing, or they are not in order.
pub(super) fn check_restarts(jpeg: &[u8]) -> Result<(), String> {
    let mut interval = 0;
    let mut frame: &[u8] = &[];
    for segment in Segments::of(jpeg) {
        match (segment.marker, segment.body) {
            (RESTART_INTERVAL, [high, low, ..]) => {
                interval = usize::from(u16::from_be_bytes([*high, *low]));
            }
            (0xc0..=0xc2, body) => frame = body,
            (START_OF_SCAN, body) if interval > 0 => {
                let Some(units) = units(frame, body).filter(|units| *units > 0) else {
                    return Ok(()); // the decoder says what is wrong
                };
                let expected = units.div_ceil(interval) - 1;
                let found = restarts(&jpeg[segment.at + 4 + body.len()..]);
                // Some encoders write one behind the last interval as well.
                if found < expected {
                    return Err(format!(
                        "the jpg has {found} of {expected} restart markers in order: a part is \
                         missing"
                    ));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

/// How many units of blocks a scan codes; `None` if its header or that of the frame is malformed.
fn units(frame: &[u8], scan: &[u8]) -> Option<usize> {
    let [_, high, low, wide, narrow, _, table @ ..] = frame else {
        return None;
    };
    let height = usize::from(u16::from_be_bytes([*high, *low]));
    let width = usize::from(u16::from_be_bytes([*wide, *narrow]));
    let sampling = |entry: &[u8]| (usize::from(entry[1] >> 4), usize::from(entry[1] & 15));
    let components = table.chunks_exact(3);
    let most_across = components.clone().map(|c| sampling(c).0).max()?;
    let most_down = components.clone().map(|c| sampling(c).1).max()?;
    if most_across == 0 || most_down == 0 {
        return None;
    }
    if *scan.first()? > 1 {
        return Some(width.div_ceil(8 * most_across) * height.div_ceil(8 * most_down));
    }
    // A scan of one component codes its blocks one by one.
    let id = scan.get(1)?;
    let (across, down) = sampling(components.clone().find(|entry| entry[0] == *id)?);
    let columns = (width * across).div_ceil(most_across).div_ceil(8);
    let rows = (height * down).div_ceil(most_down).div_ceil(8);
    Some(columns * rows)
}

/// The restart markers that follow each other in order, from the start of coded data on.
fn restarts(data: &[u8]) -> usize {
    let mut count = 0;
    for pair in data.windows(2) {
        match pair {
            [0xff, 0 | 0xff] => {}
            [0xff, marker @ 0xd0..=0xd7] if usize::from(marker - 0xd0) == count % 8 => count += 1,
            [0xff, _] => break,
            _ => {}
        }
    }
    count
}

/// Whether the scans bring all 64 coefficients of every component to full precision.
fn has_every_scan(jpeg: &[u8]) -> bool {
    let mut components: Vec<(u8, u64)> = Vec::new(); // identifier, complete coefficients as bits
    for segment in Segments::of(jpeg) {
        match (segment.marker, segment.body) {
            // Start of a frame: precision, height, width, then three bytes per component.
            (0xc0..=0xc2, [_, _, _, _, _, _, table @ ..]) => {
                components = table.chunks_exact(3).map(|entry| (entry[0], 0)).collect();
            }
            // Start of a scan: two bytes per component, then first and last coefficient and
            // precision.
            (START_OF_SCAN, [count, rest @ ..]) => {
                let Some((table, [first, last, precision, ..])) =
                    rest.split_at_checked(2 * usize::from(*count))
                else {
                    return false;
                };
                let missing_bits = precision & 15;
                for (id, complete) in &mut components {
                    if missing_bits == 0 && table.chunks_exact(2).any(|entry| entry[0] == *id) {
                        for coefficient in *first..=(*last).min(63) {
                            *complete |= 1 << coefficient;
                        }
                    }
                }
            }
            _ => {}
        }
    }
    !components.is_empty() && components.iter().all(|(_, complete)| *complete == u64::MAX)
}

/// One marker of a JPEG with its parameters.
struct Segment<'a> {
    marker: u8,
    body: &'a [u8],
    at: usize, // where the marker is in the file
}

/// Walks from marker to marker, over the coded data of scans.
struct Segments<'a> {
    jpeg: &'a [u8],
    at: usize,
}

impl Segments<'_> {
    fn of(jpeg: &[u8]) -> Segments<'_> {
        Segments { jpeg, at: 2 } // behind the start-of-image marker
    }
}

impl<'a> Iterator for Segments<'a> {
    type Item = Segment<'a>;

    fn next(&mut self) -> Option<Segment<'a>> {
        // Coded data has a 0 behind each 0xff, restart markers within, and padding before a marker.
        let rest = self.jpeg.get(self.at..)?;
        let is_marker = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0 | 0xff | 0xd0..=0xd7);
        let at = self.at + rest.windows(2).position(is_marker)?;
        let marker = self.jpeg[at + 1];
        if marker == END_OF_IMAGE[1] {
            return None;
        }
        let high = *self.jpeg.get(at + 2)?;
        let low = *self.jpeg.get(at + 3)?;
        let end = at + 2 + usize::from(u16::from_be_bytes([high, low]));
        let body = self.jpeg.get(at + 4..end)?;
        self.at = end;
        Some(Segment { marker, body, at })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: [u8; 2] = [0xff, 0xd8];
    const THUMBNAIL: [u8; 8] = [0xff, 0xe1, 0, 6, 0xff, 0xd8, 0xff, 0xd9];
    const FRAME: [u8; 16] = [0xff, 0xc0, 0, 14, 8, 0, 9, 0, 9, 2, 1, 0x11, 0, 2, 0x11, 1];

    /// The scan of some components, from one coefficient to another, lacking some bits of
    /// precision.
    fn scan(components: &[u8], first: u8, last: u8, precision: u8) -> Vec<u8> {
        let count = components.len() as u8;
        let mut scan = vec![0xff, START_OF_SCAN, 0, 6 + 2 * count, count];
        for id in components {
            scan.extend([*id, 0]);
        }
        scan.extend([first, last, precision]);
        scan.extend([1, 2, 0xff, 0, 3, 0xff, 0xd0, 4]);
        scan
    }

    #[test]
    fn end_of_a_jpeg_is_found_behind_its_headers() {
        let scan = scan(&[1, 2], 0, 63, 0);
        let cases: [(&[&[u8]], bool); 7] = [
            (&[&START, &THUMBNAIL, &scan, &END_OF_IMAGE], true),
            (&[&START, &[0xff], &scan, &END_OF_IMAGE, b"appended"], true),
            (&[&START, &THUMBNAIL, &scan], false),
            (&[&START, &THUMBNAIL], false),
            (&[&START, &THUMBNAIL[..5]], false),
            (&[&START], false),
            (&[], false),
        ];
        for (parts, expected) in cases {
            assert_eq!(
                before_end(&parts.concat()).is_some(),
                expected,
                "{parts:x?}"
            );
        }
    }

    #[test]
    fn scans_that_leave_a_coefficient_out_are_not_every_scan() {
        let cases: [(&[Vec<u8>], bool); 8] = [
            (&[scan(&[1, 2], 0, 63, 0)], true),
            (&[scan(&[1], 0, 63, 0), scan(&[2], 0, 63, 0)], true),
            (&[scan(&[1], 0, 63, 0)], false),
            (&[scan(&[1, 2], 0, 0, 0), scan(&[1], 1, 63, 0)], false),
            (
                &[
                    scan(&[1, 2], 0, 0, 0),
                    scan(&[1], 1, 63, 0),
                    scan(&[2], 1, 63, 0),
                ],
                true,
            ),
            (&[scan(&[1, 2], 0, 63, 1)], false),
            (&[scan(&[1, 2], 0, 63, 1), scan(&[1, 2], 0, 63, 0x10)], true),
            (&[], false),
        ];
        for (scans, expected) in cases {
            let jpeg = [&START[..], &FRAME, &scans.concat()].concat();
            assert_eq!(has_every_scan(&jpeg), expected, "{scans:x?}");
            assert_eq!(with_tails(&jpeg).is_some(), expected);
        }
    }

    #[test]
    fn missing_restart_markers_are_counted() {
        // 9 x 9 pixels of two components that are sampled alike: four units of two blocks.
        let head = [&START[..], &FRAME, &[0xff, RESTART_INTERVAL, 0, 4, 0, 1]].concat();
        let scan = [0xff, START_OF_SCAN, 0, 10, 2, 1, 0, 2, 0, 0, 63, 0];
        let cases: [(&[u8], bool); 6] = [
            (
                &[1, 0xff, 0xd0, 2, 0xff, 0xd1, 3, 0xff, 0, 0xff, 0xd2, 4],
                true,
            ),
            (
                &[1, 0xff, 0xd0, 2, 0xff, 0xd1, 3, 0xff, 0xd2, 4, 0xff, 0xd3],
                true,
            ),
            (&[1, 0xff, 0xd0, 2, 0xff, 0xd1, 3], false),
            (&[1, 0xff, 0xd0, 2, 0xff, 0xd2, 4], false),
            (&[1], false),
            (&[], false),
        ];
        for (data, expected) in cases {
            let jpeg = [&head[..], &scan, data, &END_OF_IMAGE].concat();
            assert_eq!(check_restarts(&jpeg).is_ok(), expected, "{data:x?}");
        }
        assert_eq!(check_restarts(&[&START[..], &FRAME].concat()), Ok(()));
    }
}
