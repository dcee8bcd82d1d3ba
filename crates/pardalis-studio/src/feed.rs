//! What the program shows: the latest message of each topic, for any number of pages.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::extract::ws::Message;
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::time::Instant;

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
    /// By the number of an open page, that of the latest message that it has shown.
    pages: Mutex<BTreeMap<u64, u64>>,
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
            pages: Mutex::default(),
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
        !self.pages().is_empty()
    }

    /// Waits until all open pages have shown what there is now, but no longer than this.
    pub fn wait_until_shown(&self, at_most: Duration) {
        let latest = self.topics().latest;
        let begin = Instant::now();
        while begin.elapsed() < at_most && self.pages().values().any(|shown| *shown < latest) {
            std::thread::sleep(Duration::from_millis(5));
        }
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

    fn pages(&self) -> MutexGuard<'_, BTreeMap<u64, u64>> {
        self.0.pages.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a page as open until the watcher is dropped.
    pub(crate) fn watcher(&self) -> Watcher {
        let mut pages = self.pages();
        let page = pages.last_key_value().map_or(0, |(last, _)| last + 1);
        pages.insert(page, 0);
        Watcher {
            feed: self.clone(),
            page,
            changes: self.0.latest.subscribe(),
            seen: 0,
        }
    }
}

/// An open page, and what it has got.
pub(crate) struct Watcher {
    feed: Feed,
    page: u64,
    changes: watch::Receiver<u64>,
    /// The number of the latest message that it has got.
    seen: u64,
}

impl Watcher {
    /// Notes that the page has shown what it has got.
    pub(crate) fn has_shown(&self) {
        self.feed.pages().insert(self.page, self.seen);
    }

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
        self.feed.pages().remove(&self.page);
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

    #[test]
    fn the_end_waits_until_every_open_page_has_shown_the_last_message() {
        const LONG: Duration = Duration::from_mins(1);
        let feed = Feed::default();
        let [mut one, other] = [feed.watcher(), feed.watcher()];
        feed.show("over", &json!(true));
        let waiting = std::thread::spawn({
            let feed = feed.clone();
            move || feed.wait_until_shown(LONG)
        });
        assert_eq!(next(&mut one).len(), 1);
        std::thread::sleep(Duration::from_millis(50));
        assert!(
            !waiting.is_finished(),
            "it has got it, and not shown it yet"
        );
        one.has_shown();
        std::thread::sleep(Duration::from_millis(50));
        assert!(!waiting.is_finished(), "the other page has not");
        // It is closed.
        drop(other);
        waiting.join().unwrap();
        // Nobody waits for a page that never answers.
        feed.show("over", &json!(true));
        feed.wait_until_shown(Duration::from_millis(1));
    }
}
