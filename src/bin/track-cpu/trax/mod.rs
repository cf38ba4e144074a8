//! `trax`: an evaluation toolkit drives the tracker through the TraX protocol.

mod picture;
mod session;

use std::io::{BufReader, BufWriter};
use std::net::{Ipv4Addr, TcpStream};

use track_cpu::source::SourceError;

use crate::args::trax::TraxArgs;
use crate::exit::Failure;
use session::Session;

/// Serves one session.
pub fn run(args: &TraxArgs) -> Result<(), Failure> {
    let model = args.engine.model(args.model.name())?;
    let options = args.engine.options(&model);
    match std::env::var("TRAX_SOCKET") {
        Ok(port) => {
            let stream = connect(&port)?;
            let read = stream.try_clone().map_err(|error| broken(&port, error))?;
            Session::new(model, options, args.protocol, BufWriter::new(stream))
                .serve(&mut BufReader::new(read))
        }
        Err(_) => {
            let out = BufWriter::new(std::io::stdout().lock());
            Session::new(model, options, args.protocol, out).serve(&mut std::io::stdin().lock())
        }
    }
}

/// The client that waits at a port of this machine.
fn connect(port: &str) -> Result<TcpStream, Failure> {
    let number: u16 = port
        .trim()
        .parse()
        .map_err(|_| broken(port, "expected a port number"))?;
    TcpStream::connect((Ipv4Addr::LOCALHOST, number)).map_err(|error| broken(port, error))
}

fn broken(port: &str, reason: impl ToString) -> Failure {
    SourceError::Format {
        input: format!("TRAX_SOCKET={port:?}"),
        reason: reason.to_string(),
    }
    .into()
}
