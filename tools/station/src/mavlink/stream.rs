//! VIDEO_STREAM_INFORMATION with its extension `encoding`, which the generated message lacks.

use ::mavlink::dialects::common::{MavMessage, VIDEO_STREAM_INFORMATION_DATA, VideoStreamEncoding};
use ::mavlink::error::ParserError;
use ::mavlink::{MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, MessageData, SigningData};

use super::unknown;

/// Bytes without extensions.
const BASE: usize = 213;

/// The message with its encoding.
struct Described<'a> {
    data: Option<&'a VIDEO_STREAM_INFORMATION_DATA>,
    encoding: u8,
}

/// The message with its encoding, signed if the link has a key.
pub fn serialized(
    data: &VIDEO_STREAM_INFORMATION_DATA,
    encoding: VideoStreamEncoding,
    header: MavHeader,
    signing: Option<&SigningData>,
) -> MAVLinkV2MessageRaw {
    let described = Described {
        data: Some(data),
        encoding: encoding as u8,
    };
    unknown::serialized(&described, header, signing)
}

impl MessageData for Described<'_> {
    type Message = MavMessage;

    const ID: u32 = VIDEO_STREAM_INFORMATION_DATA::ID;
    const NAME: &'static str = VIDEO_STREAM_INFORMATION_DATA::NAME;
    const EXTRA_CRC: u8 = VIDEO_STREAM_INFORMATION_DATA::EXTRA_CRC;
    const ENCODED_LEN: usize = BASE + 1;

    fn ser(&self, _: MavlinkVersion, payload: &mut [u8]) -> usize {
        payload[..BASE].fill(0);
        if let Some(data) = self.data {
            // Version 1 omits no zeros at the end, so that the extension has its place.
            data.ser(MavlinkVersion::V1, payload);
        }
        payload[BASE] = self.encoding;
        Self::ENCODED_LEN
    }

    fn deser(_: MavlinkVersion, payload: &[u8]) -> Result<Self, ParserError> {
        Ok(Described {
            data: None,
            encoding: payload.get(BASE).copied().unwrap_or(0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::mavlink::Message;

    #[test]
    fn encoding_follows_the_message_and_the_message_stays_readable() {
        let data = VIDEO_STREAM_INFORMATION_DATA {
            uri: "5600".into(),
            resolution_h: 640,
            ..Default::default()
        };
        let encoding = VideoStreamEncoding::VIDEO_STREAM_ENCODING_H264;

        let raw = serialized(&data, encoding, MavHeader::default(), None);

        assert_eq!(raw.payload().len(), BASE + 1);
        assert_eq!(raw.payload()[BASE], 1);
        assert!(raw.has_valid_crc::<MavMessage>());
        let parsed = MavMessage::parse(MavlinkVersion::V2, raw.message_id(), raw.payload());
        assert_eq!(parsed.unwrap(), MavMessage::VIDEO_STREAM_INFORMATION(data));
    }
}
