//! Requests to the web ground station, over a connection of their own each. The token is `fuzz-token`.
#![no_main]
#![allow(dead_code, unused_imports)]

include!("program.rs");

use libfuzzer_sys::fuzz_target;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::LazyLock;
use std::time::Duration;

static SERVER: LazyLock<SocketAddr> = LazyLock::new(|| {
    let address = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr()).expect("a free port");
    let args = serve::http::HttpArgs { http: Some(address.to_string()), token: Some("fuzz-token".into()) };
    assert!(serve::http::start(&args, &hub()).is_ok(), "the server starts");
    address
});

fuzz_target!(|bytes: &[u8]| {
    let mut stream = TcpStream::connect(*SERVER).expect("the server listens");
    // Videos have no end.
    stream.set_read_timeout(Some(Duration::from_millis(20))).expect("a timeout");
    let _ = stream.write_all(bytes).and_then(|()| stream.shutdown(Shutdown::Write));
    let mut answer = [0; 4096];
    let _ = stream.read(&mut answer);
});
