//! Messages for people, on standard error.
//!
//! A thread of its own writes them, so that a closed or blocked standard error neither ends nor
//! delays the tracker. A message for which the queue has no room is lost.

use std::io::Write;
use std::sync::OnceLock;
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::Duration;

/// Messages that may wait to be written.
const MAX_WAITING: usize = 64;

enum Item {
    Line(String),
    Flush(SyncSender<()>),
}

static QUEUE: OnceLock<SyncSender<Item>> = OnceLock::new();

fn queue() -> &'static SyncSender<Item> {
    QUEUE.get_or_init(|| {
        let (queue, items) = sync_channel(MAX_WAITING);
        std::thread::spawn(move || {
            for item in items {
                match item {
                    Item::Line(line) => {
                        let _ = writeln!(std::io::stderr(), "{line}");
                    }
                    Item::Flush(done) => {
                        let _ = done.send(());
                    }
                }
            }
        });
        queue
    })
}

/// Queues a message.
pub(crate) fn line(line: String) {
    let _ = queue().try_send(Item::Line(line));
}

/// Waits until all queued messages are written, for at most `patience`.
pub(crate) fn flush(patience: Duration) {
    let (done, said) = sync_channel(1);
    if queue().try_send(Item::Flush(done)).is_ok() {
        let _ = said.recv_timeout(patience);
    }
}

/// Writes a message to standard error; takes the arguments of `format!`.
macro_rules! say {
    ($($words:tt)*) => {
        $crate::say::line(format!($($words)*))
    };
}
pub(crate) use say;
