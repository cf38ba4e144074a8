use super::*;

#[test]
fn start_is_read_with_care() {
    let read = |text: &str| read_start(text.as_bytes());
    let start = |target, frame| Some(Command::Start { target, frame });

    let rectangle = Target::Rectangle([0.0, 0.25, 0.5, 1.0]);
    let point = Target::Point {
        x: 0.5,
        y: 0.25,
        radius: None,
    };
    for (text, expected) in [
        (
            r#"{"rectangle": [0, 0.25, 0.5, 1]}"#,
            start(rectangle, None),
        ),
        (r#"{"point": [0.5, 0.25]}"#, start(point, None)),
        (
            r#"{"point": [0.5, 0.25], "frame": 12}"#,
            start(point, Some(12)),
        ),
        ("", None),
        ("{}", None),
        ("[1,2,3,4]", None),
        (r#"{"rectangle": [0, 1]}"#, None),
        (r#"{"point": ["a", 1]}"#, None),
        (r#"{"point": [0.5, 0.25], "frame": -1}"#, None),
    ] {
        assert_eq!(read(text), expected, "{text}");
    }
}

#[test]
fn tokens_are_compared_and_checked() {
    for (a, b, expected) in [
        ("abc", "abc", true),
        ("abc", "abd", false),
        ("abc", "abcd", false),
        ("", "a", false),
    ] {
        assert_eq!(same(a.as_bytes(), b.as_bytes()), expected, "{a} {b}");
    }
    assert!(check_token("short").is_err());
    assert!(check_token("with space").is_err());
    assert!(check_token("long-enough_1").is_ok());
    assert_ne!(random_token().unwrap(), random_token().unwrap());
}

#[test]
fn token_is_read_from_a_file() {
    let path = std::env::temp_dir().join(format!("station-token-{}", std::process::id()));
    let options = HttpOptions {
        token_file: Some(path.clone()),
        ..HttpOptions::default()
    };
    std::fs::write(&path, "from-a-file\n").unwrap();
    let good = given_token(&options);
    std::fs::write(&path, "short\n").unwrap();
    let bad = given_token(&options);
    std::fs::remove_file(&path).unwrap();
    let missing = given_token(&options);

    assert_eq!(good.unwrap(), Some("from-a-file".into()));
    assert!(bad.is_err());
    assert!(missing.is_err());
}
