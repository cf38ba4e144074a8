//! Text of strangers, made fit for a terminal.

pub use weights_format::brief;

/// The text with every control character replaced, so that a terminal shows it as it is.
pub fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { '\u{fffd}' } else { c })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printable_text_with_escapes_loses_them() {
        assert_eq!(printable("a\x1b[31mb\n"), "a\u{fffd}[31mb\u{fffd}");
    }

    #[test]
    fn brief_text_of_any_length_is_bounded() {
        let text = brief("x\u{7}".repeat(5000));

        assert!(
            text.chars().count() < 400,
            "{} characters",
            text.chars().count()
        );
        assert!(text.starts_with("x\u{fffd}") && text.ends_with("..."));
    }
}
