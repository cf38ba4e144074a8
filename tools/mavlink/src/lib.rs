//! The crate `mavlink` with the messages that the station uses: the same names, a tenth of a first
//! build less.
//!
//! The messages are made by `make.py`, whose `MESSAGES` lists them. The seeds of all messages are
//! kept: one that is not used is checked and passed over whole.

#![forbid(unsafe_code)]

pub use mavlink_core::*;

/// Messages, by dialect.
pub mod dialects {
    pub mod common;
}

#[cfg(test)]
mod tests {
    use super::Message;
    use super::dialects::common::MavMessage;

    #[test]
    fn seed_of_every_message_is_known_and_of_others_is_zero() {
        let seeds = [0, 30, 76, 412, 12920, 3].map(MavMessage::extra_crc);

        assert_eq!(seeds, [50, 39, 152, 33, 20, 0]);
    }
}
