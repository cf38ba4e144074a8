//! The web page.

use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crate::support::*;

const START: &str = r#"{"rectangle": [0.43, 0.39, 0.56, 0.56]}"#;

/// `serve` on a slow flight, with a page that has been reached.
fn serve(extra: &[&str]) -> (Serving, Page) {
    let page = Page::new();
    let serving = Serving::start(&[&SLOW_FLIGHT[..], &page.options(), extra].concat());
    serving.wait_for("web page: ");
    (serving, page)
}

fn wait_for_frames(page: &Page) -> u64 {
    let frame = until(|| page.state()["frame"].as_u64().filter(|frame| *frame > 2));
    frame.expect("frames come")
}

#[test]
fn page_shows_starts_and_stops() {
    let (serving, page) = serve(&[]);
    wait_for_frames(&page);

    assert!(page.get("/").contains("<canvas"));
    let part = page.request(&page.get_text("/video"), |answer| {
        contains(answer, b"\xff\xd8\xff")
    });
    assert!(contains(&part, b"\xff\xd8\xff"), "a JPEG");
    assert!(contains(&part, b"X-Frame: "), "with its number");
    let event = page.request(&page.get_text("/events"), |answer| {
        contains(answer, b"\"frame\"")
    });
    assert!(contains(&event, b"data: {"));
    let metrics = page.get("/metrics");
    assert!(
        metrics.contains("track_cpu_source{source=\"live\"} 1"),
        "{metrics}"
    );
    assert_eq!(status(page.get("/other").as_bytes()), 404);

    assert_eq!(page.post("/start", "wrong-token", START), 403);
    let outside = r#"{"rectangle": [0, 0, 9, 9]}"#;
    assert_eq!(page.post("/start", Page::TOKEN, outside), 400);
    let tiny = r#"{"rectangle": [0.5, 0.5, 0.5001, 0.5001]}"#;
    assert_eq!(page.post("/start", Page::TOKEN, tiny), 409);
    assert_eq!(page.post("/start", Page::TOKEN, START), 202);
    let boxed = until(|| Some(page.state()).filter(|state| !state["box"].is_null()));
    assert!(boxed.is_some(), "never started");

    assert_eq!(page.post("/stop", Page::TOKEN, ""), 202);
    let idle = until(|| Some(page.state()).filter(|state| state["state"] == "idle"));
    assert!(idle.is_some(), "never stopped");
    assert_eq!(serving.end(), Some(0));
}

#[test]
fn box_is_drawn_in_the_frame_that_was_seen() {
    let folder = Folder::new("frozen");
    let log = folder.file("f.jsonl");
    let (serving, page) = serve(&["--log", &log]);
    wait_for_frames(&page);

    // Freezing keeps the frame, so a box may be drawn in it seconds later.
    let frame = page.get("/frame");
    let number = frame.split("X-Frame: ").nth(1).expect("a number");
    let number: u64 = number.lines().next().unwrap().parse().unwrap();
    let later = until(|| page.state()["frame"].as_u64().filter(|f| *f > number + 20));
    assert!(later.is_some());
    let start = format!(r#"{{"rectangle": [0.43, 0.39, 0.56, 0.56], "frame": {number}}}"#);

    assert_eq!(page.post("/start", Page::TOKEN, &start), 202);

    assert_eq!(serving.end(), Some(0));
    let log_text = std::fs::read_to_string(&log).unwrap();
    assert!(log_text.contains(&format!("\"at\":{number}")), "{number}");
    let replayed = run(&["replay", &log]);
    let said = String::from_utf8_lossy(&replayed.stderr);
    assert!(replayed.status.success(), "{said}");
}

#[test]
fn other_sites_are_refused_and_may_not_embed_the_video() {
    let (_serving, page) = serve(&["--http-name", "drone.example"]);
    for (host, expected) in [
        ("evil.example", 421),
        ("drone.example:8080", 200),
        ("localhost", 200),
        (page.address.as_str(), 200),
    ] {
        for path in ["/state", "/"] {
            let text = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n");
            let answer = page.request(&text, |_| false);

            assert_eq!(status(&answer), expected, "{host} {path}");
            let protected = b"Cross-Origin-Resource-Policy: same-origin";
            assert!(contains(&answer, protected), "{host} {path}");
        }
    }
    let text = "GET /video HTTP/1.1\r\nHost: evil.example\r\n\r\n";
    assert_eq!(status(&page.request(text, |_| false)), 421);
    let head = format!("HEAD / HTTP/1.1\r\nHost: {}\r\n\r\n", page.address);
    let answer = page.request(&head, |_| false);
    assert_eq!(status(&answer), 200);
    assert!(answer.ends_with(b"\r\n\r\n"), "no body");
}

#[test]
fn private_page_is_watched_with_the_token_only() {
    let (serving, page) = serve(&["--private"]);
    let with = format!("?token={}", Page::TOKEN);

    for path in ["/state", "/video", "/events", "/frame"] {
        assert_eq!(status(page.get(path).as_bytes()), 403, "{path}");
    }
    assert_eq!(status(page.get("/").as_bytes()), 200);
    let state = page.get(&format!("/state{with}"));
    assert_eq!(status(state.as_bytes()), 200);
    let video = page.request(&page.get_text(&format!("/video{with}")), |answer| {
        contains(answer, b"X-Frame")
    });
    assert_eq!(status(&video), 200);
    assert!(
        !serving.said().contains(Page::TOKEN),
        "the token is not shown"
    );
}

#[test]
fn stop_gets_through_slow_connections() {
    let (_serving, page) = serve(&[]);
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for _ in 0..80 {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    let Ok(mut stream) = TcpStream::connect(&page.address) else {
                        continue;
                    };
                    let mut line: &[u8] = b"GET / HTTP/1.1\r\n";
                    while !is_over.load(Ordering::Relaxed) && stream.write_all(line).is_ok() {
                        line = b"A: b\r\n";
                        std::thread::sleep(Duration::from_millis(400));
                    }
                }
            });
        }
        std::thread::sleep(Duration::from_secs(1));

        let stopped: Vec<u16> = (0..10)
            .map(|_| page.post("/stop", Page::TOKEN, ""))
            .collect();

        is_over.store(true, Ordering::Relaxed);
        assert_eq!(stopped, [202; 10]);
    });
}
