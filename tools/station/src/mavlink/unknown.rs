//! Commands whose number has no name in the dialect. They are refused like all others that a camera
//! does not support.
//!
//! The parser rejects such a message as a whole, so this file reads the few bytes that matter and
//! writes the answer.

use ::mavlink::dialects::common::MavResult;
use ::mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavMessage,
};
use ::mavlink::error::ParserError;
use ::mavlink::{
    MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkVersion, MessageData, SigningData,
};

/// Bit of the header's incompatibility flags: a signature follows.
const SIGNED: u8 = 1;

/// A command without a name: its number and its addressee.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unknown {
    /// Its number.
    pub command: u16,
    /// The system that it is for; 0 is every system.
    pub system: u8,
    /// The component that it is for; 0 is every component.
    pub component: u8,
}

impl Unknown {
    /// The command of a message that could not be parsed, if it holds one.
    pub fn of(message: &MAVLinkMessageRaw) -> Option<Unknown> {
        if ![COMMAND_LONG_DATA::ID, COMMAND_INT_DATA::ID].contains(&message.message_id()) {
            return None;
        }
        // In both, the command follows 28 bytes of parameters; version 2 omits zeros at the end.
        let byte = |at: usize| message.payload().get(at).copied().unwrap_or(0);
        let command = u16::from_le_bytes([byte(28), byte(29)]);
        Some(Unknown {
            command,
            system: byte(30),
            component: byte(31),
        })
    }

    /// The acknowledgement that says that the command is unsupported.
    pub fn refusal(&self, header: MavHeader, signing: Option<&SigningData>) -> MAVLinkV2MessageRaw {
        serialized(&Refusal(self.command), header, signing)
    }
}

/// A message without a generated type, signed if the link has a key.
pub fn serialized(
    data: &impl MessageData,
    header: MavHeader,
    signing: Option<&SigningData>,
) -> MAVLinkV2MessageRaw {
    let mut message = MAVLinkV2MessageRaw::new();
    if signing.is_some() {
        *message.incompatibility_flags_mut() = SIGNED;
    }
    message.serialize_message_data(header, data);
    if let Some(signing) = signing {
        signing.sign_message(&mut message);
    }
    message
}

/// COMMAND_ACK whose command is a mere number.
struct Refusal(u16);

impl MessageData for Refusal {
    type Message = MavMessage;

    const ID: u32 = COMMAND_ACK_DATA::ID;
    const NAME: &'static str = COMMAND_ACK_DATA::NAME;
    const EXTRA_CRC: u8 = COMMAND_ACK_DATA::EXTRA_CRC;
    const ENCODED_LEN: usize = 3;

    fn ser(&self, _: MavlinkVersion, payload: &mut [u8]) -> usize {
        payload[..2].copy_from_slice(&self.0.to_le_bytes());
        payload[2] = MavResult::MAV_RESULT_UNSUPPORTED as u8;
        Self::ENCODED_LEN
    }

    fn deser(_: MavlinkVersion, payload: &[u8]) -> Result<Self, ParserError> {
        let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
        Ok(Refusal(u16::from_le_bytes([byte(0), byte(1)])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::mavlink::dialects::common::MavCmd;
    use ::mavlink::{Message, SigningConfig};

    #[test]
    fn command_without_a_name_is_read_and_refused() {
        let header = MavHeader {
            system_id: 255,
            component_id: 190,
            sequence: 0,
        };
        let message = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_DO_SET_HOME,
            target_system: 1,
            target_component: 100,
            ..Default::default()
        });
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(header, &message);
        let unknown = Unknown::of(&MAVLinkMessageRaw::V2(raw)).unwrap();
        let command = MavCmd::MAV_CMD_DO_SET_HOME as u16;
        assert_eq!(
            unknown,
            Unknown {
                command,
                system: 1,
                component: 100
            }
        );

        let signing = SigningData::from_config(SigningConfig::new([7; 32], 1, true, false));
        for signing in [None, Some(&signing)] {
            let refusal = unknown.refusal(header, signing);
            let parsed =
                MavMessage::parse(MavlinkVersion::V2, refusal.message_id(), refusal.payload())
                    .unwrap();
            let MavMessage::COMMAND_ACK(ack) = parsed else {
                panic!("{parsed:?}")
            };
            assert_eq!(
                (ack.command as u16, ack.result),
                (command, MavResult::MAV_RESULT_UNSUPPORTED)
            );
            assert!(signing.is_none_or(|signing| signing.verify_signature(&refusal)));
        }

        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(
            header,
            &MavMessage::COMMAND_ACK(COMMAND_ACK_DATA::default()),
        );
        assert_eq!(Unknown::of(&MAVLinkMessageRaw::V2(raw)), None);
    }
}
