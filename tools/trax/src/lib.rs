//! TraX, the protocol between evaluation toolkits (clients) and trackers (servers): messages,
//! regions and pictures as text. Both ends are built on this crate; it knows nothing of trackers.
//!
//! A message is a line: `@@TRAX:` and a name, then arguments in quotes and properties `key=value`.
//! Lines without the prefix are the program's own talk and passed over.
//!
//! | | up to version 3 | version 4 |
//! |---|---|---|
//! | server | `hello` with version, name and the forms it takes | the same |
//! | client | `initialize IMAGE REGION` | `initialize REGION` for each object, then `frame IMAGE` |
//! | server | `state REGION` | `state REGION` for each object, in order |
//! | client | `frame IMAGE`, answered by `state` | the same |
//! | client | `initialize` once more: another object | `initialize` alone: forget all objects |
//! | either | `quit`, perhaps with `trax.reason` | the same |
//!
//! Nothing a stranger writes makes this crate panic or hold more than [`MAX_LINE`] bytes a few
//! times over. Source: the protocol's reference, and what its client library 4.0.2 sends.

#![forbid(unsafe_code)]

pub mod base64;
mod error;
mod message;
mod picture;
mod region;

pub use error::Error;
pub use message::{Kind, MAX_LINE, Message, PREFIX, read};
pub use picture::{Picture, Pixels};
pub use region::{Rectangle, Region};
