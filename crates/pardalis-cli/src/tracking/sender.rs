//! Estimates for other programs, such as that of a robot, while tracking: one line of JSON per time, over UDP or TCP.
//!
//! The latest line wins: whoever takes them too slowly, or is not there, costs neither memory nor time of tracking. What was not sent is counted.

use std::fmt;
use std::io::{ErrorKind, Write as _};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs as _, UdpSocket};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context as _, Result};
use pardalis_scene::{Scene, TargetConfig};
use serde_json::json;

use super::{Instant, Sink, Tracked};
use crate::timing::{Stopwatch, now_s, unix_s_at};
use crate::user_error::user_error;

/// The waits between attempts to connect, the first and the longest.
const PAUSES: [Duration; 2] = [Duration::from_millis(100), Duration::from_secs(5)];
/// How long a connection or a line may take.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long the last line may take at the end.
const LAST: Duration = Duration::from_secs(1);

/// Where estimates are sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Destination {
    protocol: Protocol,
    /// Host and port.
    place: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Protocol {
    Udp,
    Tcp,
}

impl fmt::Display for Destination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let protocol = match self.protocol {
            Protocol::Udp => "udp",
            Protocol::Tcp => "tcp",
        };
        write!(f, "{protocol}://{}", self.place)
    }
}

impl Destination {
    /// Parses `udp://HOST:PORT` or `tcp://HOST:PORT`.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let allowed =
            "allowed: udp://HOST:PORT or tcp://HOST:PORT, such as udp://192.168.1.20:7000";
        let (protocol, place) = text.split_once("://").ok_or(allowed)?;
        let protocol = match protocol {
            "udp" => Protocol::Udp,
            "tcp" => Protocol::Tcp,
            "ws" | "wss" => {
                return Err("a WebSocket is served with --watch, for any number of readers (docs/live-output.md)".to_owned());
            }
            _ => return Err(allowed.to_owned()),
        };
        let (host, port) = place.rsplit_once(':').ok_or(allowed)?;
        if host.is_empty() || port.parse::<u16>().ok().is_none_or(|port| port == 0) {
            return Err(allowed.to_owned());
        }
        Ok(Self {
            protocol,
            place: place.to_owned(),
        })
    }

    fn addresses(&self) -> Result<Vec<SocketAddr>> {
        let found = self.place.to_socket_addrs();
        let found = found.map_err(|error| {
            user_error!(
                "--send {self}: the host is not known ({error}); check its name, or give its number"
            )
        })?;
        Ok(found.collect())
    }
}

/// Sends estimates to one destination.
pub(crate) struct Sender {
    destination: Destination,
    targets: Vec<TargetConfig>,
    slot: Arc<Slot>,
    thread: Option<JoinHandle<()>>,
}

/// The line that is sent next.
#[derive(Default)]
struct Slot {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// Without its end, to which the number of dropped lines is added.
    line: Option<String>,
    sent: u64,
    dropped: u64,
    /// Why the last attempt to connect or to send failed.
    failure: Option<String>,
    is_over: bool,
}

impl Slot {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a line; `None` at the end.
    fn next(&self) -> Option<String> {
        let mut state = self.state();
        loop {
            if let Some(line) = state.line.take() {
                return Some(format!("{line},\"dropped\":{}}}\n", state.dropped));
            }
            if state.is_over {
                return None;
            }
            state = self
                .changed
                .wait(state)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Counts a line, which was sent or failed. Reports whether it was sent.
    fn count(&self, sent: Result<(), std::io::Error>) -> bool {
        let mut state = self.state();
        state.sent += u64::from(sent.is_ok());
        state.dropped += u64::from(sent.is_err());
        let is_sent = sent.is_ok();
        state.failure = sent.err().map(|error| error.to_string());
        is_sent
    }

    /// Waits before another attempt to connect. Lines that come meanwhile replace each other. Reports whether to go on.
    fn waits(&self, pause: Duration) -> bool {
        let state = self.state();
        let waited = self
            .changed
            .wait_timeout_while(state, pause, |state| !state.is_over);
        let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        !state.is_over
    }
}

impl Sender {
    /// Starts to send.
    ///
    /// Errors: the host is not known.
    pub(crate) fn start(destination: &Destination, scene: &Scene) -> Result<Self> {
        let addresses = destination.addresses()?;
        let slot = Arc::new(Slot::default());
        let protocol = destination.protocol;
        let thread = std::thread::Builder::new()
            .name("sender".to_owned())
            .spawn({
                let slot = Arc::clone(&slot);
                move || match protocol {
                    Protocol::Udp => send_datagrams(&slot, &addresses),
                    Protocol::Tcp => send_stream(&slot, &addresses),
                }
            });
        Ok(Self {
            destination: destination.clone(),
            targets: scene.targets.clone(),
            slot,
            thread: Some(thread.context("no further thread can be started")?),
        })
    }

    /// Leaves the last line some time, ends, and returns how many were sent and dropped.
    pub(crate) fn finish(self) -> String {
        let watch = Stopwatch::start();
        while self.slot.state().line.is_some() && watch.elapsed_s() < LAST.as_secs_f64() {
            std::thread::sleep(Duration::from_millis(5));
        }
        let (destination, slot) = (self.destination.clone(), Arc::clone(&self.slot));
        drop(self);
        let state = slot.state();
        let dropped = state.dropped + u64::from(state.line.is_some());
        let why = match &state.failure {
            Some(failure) if dropped > 0 => {
                format!(" ({failure}; start the receiver, or check address and port)")
            }
            _ => String::new(),
        };
        format!(
            "{destination}: sent {} estimates, dropped {dropped}{why}",
            state.sent
        )
    }
}

/// Returns the line of one time without its end, to which the number of dropped lines is to be added: `,"dropped":N}`.
pub(super) fn open_line(instant: &Instant, targets: &[TargetConfig]) -> String {
    let written = |tracked: &Tracked| {
        let estimate = &tracked.estimate;
        let known = estimate.kinematics.as_ref();
        json!({
            "name": tracked.name(targets),
            "state": estimate.state.name(),
            "confidence": estimate.confidence,
            "position_m": known.map(|known| known.position_m),
            "velocity_mps": known.and_then(|known| known.velocity_mps),
            "covariance_m2": known.map(|known| known.covariance_m2),
            "velocity_covariance_m2ps2": known.and_then(|known| known.velocity_covariance_m2ps2),
            "heading_rad": estimate.heading_rad,
        })
    };
    let targets: Vec<_> = instant.tracked.iter().map(written).collect();
    let line = json!({
        "frame": instant.index,
        "time_s": instant.time_s,
        "captured_unix_s": instant.captured_s.map(unix_s_at),
        "sent_unix_s": unix_s_at(now_s()),
        "targets": targets,
    });
    let mut line = line.to_string();
    line.pop();
    line
}

impl Sink for Sender {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        let line = open_line(instant, &self.targets);
        let mut state = self.slot.state();
        if state.line.replace(line).is_some() {
            state.dropped += 1;
        }
        drop(state);
        self.slot.changed.notify_all();
        Ok(())
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.slot.state().is_over = true;
        self.slot.changed.notify_all();
        if let Some(thread) = self.thread.take() {
            // A panic has been reported.
            let _ = thread.join();
        }
    }
}

fn send_datagrams(slot: &Slot, addresses: &[SocketAddr]) {
    let own = |address: &SocketAddr| {
        if address.is_ipv4() {
            "0.0.0.0:0"
        } else {
            "[::]:0"
        }
    };
    let open = |address: &SocketAddr| {
        let socket = UdpSocket::bind(own(address))?;
        socket.connect(address)?;
        Ok::<_, std::io::Error>(socket)
    };
    let socket = addresses.first().map(open);
    while let Some(line) = slot.next() {
        // A receiver that is not there may come later.
        let sent = match &socket {
            Some(Ok(socket)) => socket.send(line.as_bytes()).map(|_| ()),
            Some(Err(error)) => Err(error.kind().into()),
            None => Err(ErrorKind::AddrNotAvailable.into()),
        };
        slot.count(sent);
    }
}

fn send_stream(slot: &Slot, addresses: &[SocketAddr]) {
    let connect = || {
        let mut streams = addresses
            .iter()
            .map(|address| TcpStream::connect_timeout(address, PATIENCE));
        let stream = streams.find_map(|stream| {
            let failed = |error: std::io::Error| slot.state().failure = Some(error.to_string());
            stream.map_err(failed).ok()
        })?;
        let is_ready =
            stream.set_nodelay(true).is_ok() && stream.set_write_timeout(Some(PATIENCE)).is_ok();
        is_ready.then_some(stream)
    };
    let [first_pause, longest_pause] = PAUSES;
    let mut pause = first_pause;
    let mut stream = connect();
    loop {
        let Some(open) = &mut stream else {
            if !slot.waits(pause) {
                return;
            }
            pause = (2 * pause).min(longest_pause);
            stream = connect();
            continue;
        };
        let Some(line) = slot.next() else {
            return;
        };
        let is_sent = slot.count(open.write_all(line.as_bytes()));
        if is_sent {
            pause = first_pause;
        } else {
            // Part of a line may have been sent: a new connection begins with a whole one.
            stream = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn destinations_are_an_address_of_udp_or_tcp() {
        for text in [
            "udp://127.0.0.1:7000",
            "tcp://robot.local:1",
            "udp://[::1]:9",
        ] {
            assert_eq!(Destination::parse(text).unwrap().to_string(), text);
        }
        for text in [
            "",
            "udp://",
            "udp://a",
            "udp://a:0",
            "udp://:7",
            "http://a:80",
            "tcp://a:70000",
            "a:7000",
        ] {
            assert!(
                Destination::parse(text)
                    .unwrap_err()
                    .contains("udp://192.168.1.20:7000"),
                "{text}"
            );
        }
    }
}
