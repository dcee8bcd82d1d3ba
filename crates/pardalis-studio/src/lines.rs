//! Lines of JSON for other programs, over a WebSocket: the latest wins.

use std::sync::Arc;

use axum::extract::ws::{Message, Utf8Bytes, WebSocket};
use tokio::sync::watch;
use tokio::time::timeout;

use crate::live::GONE;

/// The latest line, for any number of readers. Cloning shares it.
///
/// A line replaces the one before it. A reader that is too slow gets fewer, and every line says how many it did not get so far.
#[derive(Debug, Clone)]
pub struct Lines(Arc<watch::Sender<Numbered>>);

#[derive(Debug, Default)]
struct Numbered {
    /// From 1; 0 stands for no line.
    number: u64,
    line: String,
}

impl Default for Lines {
    fn default() -> Self {
        Self(Arc::new(watch::Sender::default()))
    }
}

impl Lines {
    /// Sends an object of JSON without its last brace, to which the number of lines that a reader did not get is added, as `dropped`.
    pub fn send(&self, line: String) {
        self.0.send_modify(|latest| {
            latest.number += 1;
            latest.line = line;
        });
    }

    /// Reports whether anybody reads them: otherwise, none need be written.
    pub fn are_read(&self) -> bool {
        self.0.receiver_count() > 0
    }

    pub(crate) fn reader(&self) -> Reader {
        let mut latest = self.0.subscribe();
        let seen = latest.borrow_and_update().number;
        Reader {
            latest,
            seen,
            dropped: 0,
        }
    }
}

/// A reader, which gets what is sent from now on.
pub(crate) struct Reader {
    latest: watch::Receiver<Numbered>,
    /// The number of the last line that it has got or that was sent before it came.
    seen: u64,
    dropped: u64,
}

impl Reader {
    /// Waits for the next line and returns it whole.
    async fn next(&mut self) -> Utf8Bytes {
        // The server has a sender as long as it runs.
        let _ = self.latest.changed().await;
        let latest = self.latest.borrow_and_update();
        self.dropped += latest.number - self.seen - 1;
        self.seen = latest.number;
        format!("{},\"dropped\":{}}}\n", latest.line, self.dropped).into()
    }
}

/// Serves a reader until it is gone or sends anything but control messages.
pub(crate) async fn serve(mut socket: WebSocket, mut reader: Reader) {
    loop {
        tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => break,
            },
            line = reader.next() => {
                let sent = timeout(GONE, socket.send(Message::Text(line))).await;
                if !matches!(sent, Ok(Ok(()))) {
                    break;
                }
            }
        }
    }
}
