//! `serve` and `replay` as programs, with everything around them that may fail.
//!
//! | file | what is tested |
//! |---|---|
//! | `commands.rs` | commands as JSON lines from other programs |
//! | `faults.rs` | frames stop, disks fill, links break, viewers sleep, the program is killed |
//! | `log.rs` | a flight done again, box for box |
//! | `mavlink.rs` | MAVLink as ground stations speak it |
//! | `page.rs` | the web page |
//! | `video.rs` | the video with boxes burnt in |
//! | `targets.rs` | several targets at a time |
//! | `pick.rs` | the box of `track`, drawn on the web page |
//! | `support.rs` | running programs, a camera on a pipe, a ground station |

#![cfg(all(feature = "serve", unix))]

mod commands;
mod faults;
mod log;
mod mavlink;
mod page;
mod pick;
mod support;
mod targets;
mod video;
