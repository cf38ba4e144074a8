//! Whatever a stranger writes gives a value or an error, never a panic.

use proptest::prelude::*;
use trax::{Message, Picture, Region, base64};

/// Text that is nearly a message: its words, and anything between them.
fn nearly() -> impl Strategy<Value = String> {
    let known = prop::sample::select(vec![
        "@@TRAX:",
        "hello",
        "initialize",
        "frame",
        "state",
        "quit",
        " ",
        "\"",
        "\\",
        "=",
        ",",
        ";",
        ":",
        "mask:",
        "m",
        "image:",
        "data:",
        "file://",
        "/",
        "rgb",
        "gray16",
        "base64",
        "1",
        "-1",
        "0",
        "3.5",
        "nan",
        "1e400",
        "32768",
        "18446744073709551615",
        "AAAA",
        "==",
        "\n",
        "\u{e9}",
    ]);
    let part =
        prop_oneof![4 => known.prop_map(str::to_owned), 1 => any::<char>().prop_map(String::from)];
    prop::collection::vec(part, 0..24).prop_map(|parts| parts.concat())
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 2000,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn text(text in nearly()) {
        for line in [text.clone(), format!("@@TRAX:frame {text}")] {
            if let Some(Ok(message)) = Message::parse(&line) {
                // Line ends within a message are escaped; it is what it was.
                let text = message.to_string();
                let again = Message::parse(&text).expect("a prefix").expect("a message");
                prop_assert_eq!(again, message);
            }
        }
        for text in [text.clone(), format!("mask:{text}"), format!("1,2,{text}")] {
            if let Ok(region) = Region::parse(&text) {
                let r = region.rectangle();
                prop_assert!(r.x.is_finite() && r.y.is_finite());
            }
        }
        for text in [text.clone(), format!("image:{text}"), format!("data:{text}")] {
            if let Ok(Picture::Memory { width, height, pixels, data }) = Picture::parse(&text) {
                prop_assert_eq!(data.len(), width * height * pixels.bytes());
            }
        }
    }

    #[test]
    fn bytes(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
        prop_assert_eq!(base64::decode(&base64::encode(&bytes)), Some(bytes.clone()));
        let _ = trax::read(&mut &bytes[..], &mut Vec::new());
    }
}
