//! What the program shows: the latest message of each topic, for any number of pages.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::ws::Message;
use serde_json::{Value, json};
use tokio::sync::watch;

/// The latest message of each topic. Cloning shares it.
///
/// A message replaces the one before it, whether or not a page has taken that: memory is bounded by the number of topics, and nothing waits for a
/// slow page. Every message has a sequence number within its topic, from which the page knows how many it did not get.
#[derive(Debug, Clone)]
pub struct Feed(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    topics: Mutex<Topics>,
    /// The number of the latest message of all topics.
    latest: watch::Sender<u64>,
    watchers: AtomicUsize,
}

#[derive(Debug, Default)]
struct Topics {
    latest: u64,
    entries: BTreeMap<String, Entry>,
}

#[derive(Debug)]
struct Entry {
    /// Its number among the messages of all topics.
    number: u64,
    /// Its number among those of its topic, from 1.
    sequence: u64,
    message: Message,
}

impl Default for Feed {
    fn default() -> Self {
        Self(Arc::new(Shared {
            topics: Mutex::default(),
            latest: watch::Sender::new(0),
            watchers: AtomicUsize::new(0),
        }))
    }
}

impl Feed {
    /// Shows a value, in place of the last one of its topic.
    pub fn show(&self, topic: &str, value: &Value) {
        self.push(topic, |sequence| {
            let text = json!({ "topic": topic, "sequence": sequence, "value": value });
            Message::text(text.to_string())
        });
    }

    /// Shows an image, the bytes of a file, in place of the last one of its topic. `about` is sent with it.
    pub fn show_image(&self, topic: &str, about: &Value, image: &[u8]) {
        self.push(topic, |sequence| {
            let head = json!({ "topic": topic, "sequence": sequence, "value": about }).to_string();
            // The length of the head in bytes, the head, and the image.
            let length = u32::try_from(head.len()).unwrap_or(u32::MAX);
            Message::binary([&length.to_be_bytes(), head.as_bytes(), image].concat())
        });
    }

    /// Withdraws the message of a topic, such as the picture of a camera that has been removed.
    pub fn withdraw(&self, topic: &str) {
        self.topics().entries.remove(topic);
    }

    /// Reports whether a page is open: otherwise, nothing need be prepared.
    pub fn is_watched(&self) -> bool {
        self.0.watchers.load(Ordering::Relaxed) > 0
    }

    fn push(&self, topic: &str, message: impl FnOnce(u64) -> Message) {
        let mut topics = self.topics();
        topics.latest += 1;
        let number = topics.latest;
        let before = topics.entries.get(topic).map_or(0, |entry| entry.sequence);
        let entry = Entry {
            number,
            sequence: before + 1,
            message: message(before + 1),
        };
        topics.entries.insert(topic.to_owned(), entry);
        self.0.latest.send_replace(number);
    }

    fn topics(&self) -> MutexGuard<'_, Topics> {
        // A message is whole or absent, whatever panicked.
        self.0.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a page as open until the watcher is dropped.
    pub(crate) fn watcher(&self) -> Watcher {
        self.0.watchers.fetch_add(1, Ordering::Relaxed);
        Watcher {
            feed: self.clone(),
            changes: self.0.latest.subscribe(),
            seen: 0,
        }
    }
}

/// An open page, and what it has got.
pub(crate) struct Watcher {
    feed: Feed,
    changes: watch::Receiver<u64>,
    /// The number of the latest message that it has got.
    seen: u64,
}

impl Watcher {
    /// Waits for messages that the page has not got, and returns the latest of each topic, the oldest first.
    pub(crate) async fn next(&mut self) -> Vec<Message> {
        let seen = self.seen;
        // The sender lives as long as the feed, which this watcher holds.
        let _ = self.changes.wait_for(|latest| *latest > seen).await;
        let topics = self.feed.topics();
        let mut new: Vec<&Entry> = topics
            .entries
            .values()
            .filter(|entry| entry.number > seen)
            .collect();
        new.sort_by_key(|entry| entry.number);
        self.seen = topics.latest;
        new.into_iter().map(|entry| entry.message.clone()).collect()
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.feed.0.watchers.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn next(watcher: &mut Watcher) -> Vec<Value> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .build()
            .unwrap();
        let messages = runtime.block_on(watcher.next());
        messages
            .iter()
            .map(|message| serde_json::from_str(message.to_text().unwrap()).unwrap())
            .collect()
    }

    #[test]
    fn a_page_gets_the_latest_of_each_topic_and_can_count_what_it_missed() {
        let feed = Feed::default();
        assert!(!feed.is_watched());
        for number in 0..5 {
            feed.show("a", &json!(number));
        }
        feed.show("b", &json!("x"));
        let mut page = feed.watcher();
        assert!(feed.is_watched());
        let got = next(&mut page);
        assert_eq!(
            got,
            [
                json!({"topic": "a", "sequence": 5, "value": 4}),
                json!({"topic": "b", "sequence": 1, "value": "x"}),
            ]
        );
        feed.show("a", &json!(5));
        feed.show("a", &json!(6));
        feed.withdraw("b");
        let got = next(&mut page);
        assert_eq!(got, [json!({"topic": "a", "sequence": 7, "value": 6})]);
        drop(page);
        assert!(!feed.is_watched());
    }
}
