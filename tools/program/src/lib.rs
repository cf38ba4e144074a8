//! What `track-cpu`, `ope`, `train`, `convert` and `flightlab` share, so that they behave alike.
//!
//! | file | what it holds |
//! |---|---|
//! | `exit.rs` | the one table of exit codes |
//! | `output.rs` | outputs that never destroy an input, and files that replace others only when they are good |
//! | `text.rs` | text of strangers, made fit for a terminal |
//!
//! ```
//! use program::Exit;
//!
//! assert_eq!(Exit::Input.code(), 3);
//! assert!(program::exit_help().contains("  3  an input cannot be read"));
//! ```

#![forbid(unsafe_code)]

mod exit;
mod output;
mod text;

pub use exit::{Exit, exit_help};
pub use output::{Clash, NewFile, check_outputs};
pub use text::{brief, printable};
