//! TraX messages with their pictures and regions.
#![no_main]

use libfuzzer_sys::fuzz_target;
use trax::{Message, Picture, Region};

fuzz_target!(|bytes: &[u8]| {
    let (mut stream, mut line) = (bytes, Vec::new());
    while let Ok(Some(message)) = trax::read(&mut stream, &mut line) {
        for argument in &message.arguments {
            if let Ok(region) = Region::parse(argument) {
                region.rectangle();
            }
            let _ = Picture::parse(argument);
        }
        let again = Message::parse(&message.to_string());
        assert_eq!(
            again.and_then(Result::ok).as_ref(),
            Some(&message),
            "written and read again"
        );
    }
});
