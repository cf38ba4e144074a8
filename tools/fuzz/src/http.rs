//! Requests to the web page, over a connection of their own each. The token is `fuzz-token`.
#![no_main]

mod live;

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::LazyLock;
use std::time::Duration;

use libfuzzer_sys::fuzz_target;
use station::http::{HttpOptions, start};

static SERVER: LazyLock<SocketAddr> = LazyLock::new(|| {
    let free = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr());
    let address = free.expect("a free port");
    let options = HttpOptions {
        address: Some(address.to_string()),
        token: Some("fuzz-token".into()),
        ..HttpOptions::default()
    };
    assert!(start(&options, &live::hub()).is_ok(), "the server starts");
    address
});

fuzz_target!(|bytes: &[u8]| {
    let mut stream = TcpStream::connect(*SERVER).expect("the server listens");
    // Videos have no end.
    let patience = Some(Duration::from_millis(20));
    stream.set_read_timeout(patience).expect("a time-out");
    let sent = stream.write_all(bytes);
    let _ = sent.and_then(|()| stream.shutdown(Shutdown::Write));
    let mut answer = [0; 4096];
    let _ = stream.read(&mut answer);
});
