use super::*;

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
fn stop_is_of_all_targets_unless_it_names_one() {
    for (body, expected) in [
        ("", Some(None)),
        ("{}", Some(None)),
        (r#"{"target": 2}"#, Some(Some(2))),
        (r#"{"target": "2"}"#, None),
        ("nonsense", None),
    ] {
        let stop = expected.map(|id| Command::Stop { id });

        assert_eq!(read_stop(body.as_bytes()), stop, "{body}");
    }
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
    #[cfg(unix)]
    {
        let device = HttpOptions {
            token_file: Some("/dev/zero".into()),
            ..HttpOptions::default()
        };
        let endless = given_token(&device).unwrap_err().to_string();
        assert!(endless.contains("/dev/zero: holds more than"), "{endless}");
    }
}
