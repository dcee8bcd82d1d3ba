//! The WebSocket over which a page gets what is new.
//!
//! The page asks with the text `more`, and gets the latest message of each topic that is new, and `end`. It asks again when it has shown them: a slow
//! page or network gets fewer messages, and never late ones.

use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use tokio::time::{Instant, interval_at, timeout};

use crate::feed::Feed;

/// The longest message that a page may send, in bytes.
pub(crate) const MAX_MESSAGE_BYTES: usize = 64;

/// How often a page is asked whether it is still there.
const PING: Duration = Duration::from_secs(20);

/// A page is gone if nothing comes from it for so long, or if it does not take a message for so long.
pub(crate) const GONE: Duration = Duration::from_mins(1);

/// Serves a page until it is gone or breaks the rules.
pub(crate) async fn serve(mut socket: WebSocket, feed: Feed) {
    let mut watcher = feed.watcher();
    let mut pings = interval_at(Instant::now() + PING, PING);
    let mut heard = Instant::now();
    let mut is_owed = false;
    loop {
        tokio::select! {
            message = socket.recv() => match message {
                Some(Ok(Message::Text(text))) if text == "more" => {
                    watcher.has_shown();
                    is_owed = true;
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                _ => break,
            },
            messages = watcher.next(), if is_owed => {
                is_owed = false;
                for message in messages.into_iter().chain([Message::text("end")]) {
                    if !is_sent(&mut socket, message).await {
                        return;
                    }
                }
                continue;
            }
            _ = pings.tick() => {
                let ping = Message::Ping(axum::body::Bytes::new());
                if heard.elapsed() > GONE || !is_sent(&mut socket, ping).await {
                    break;
                }
                continue;
            }
        }
        heard = Instant::now();
    }
}

async fn is_sent(socket: &mut WebSocket, message: Message) -> bool {
    matches!(timeout(GONE, socket.send(message)).await, Ok(Ok(())))
}
