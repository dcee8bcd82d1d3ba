//! The server on a real port, with requests that browsers, other pages and hostile programs send.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use pardalis_studio::{Asset, Extension, Feed, Lines, Program, Server};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Message, WebSocket};

/// Answers with what it is asked.
struct Echo;

impl Program for Echo {
    fn answer(&self, request: &str, value: Value) -> Result<Value, String> {
        match request {
            "fail" => Err("it is wrong; do it right".to_owned()),
            "panic" => panic!("the program has a defect"),
            _ => Ok(json!({ "request": request, "value": value })),
        }
    }
}

fn server(listen: &str) -> (Server, SocketAddr, Feed) {
    server_with(listen, Lines::default())
}

fn server_with(listen: &str, lines: Lines) -> (Server, SocketAddr, Feed) {
    let feed = Feed::default();
    let asset = Asset {
        path: "extra/a.js".into(),
        content_type: "text/javascript",
        bytes: b"export {};",
    };
    let extension = Extension {
        assets: vec![asset],
        import_map: "{\"imports\": {\"a\": \"/extra/a.js\"}}".to_owned(),
        lines,
    };
    let listen = listen.parse().unwrap();
    let server = Server::start(listen, Arc::new(Echo), feed.clone(), extension);
    let server = server.unwrap();
    let place = server.address().strip_prefix("http://").unwrap();
    let place: SocketAddr = place.split('/').next().unwrap().parse().unwrap();
    (
        server,
        SocketAddr::new([127, 0, 0, 1].into(), place.port()),
        feed,
    )
}

/// Sends a request as it stands and returns the reply.
fn reply(address: SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(30)))
        .unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut reply = Vec::new();
    // The server may close while the rest of a long body is still under way.
    if let Err(error) = stream.read_to_end(&mut reply) {
        assert_eq!(error.kind(), ErrorKind::ConnectionReset, "{error}");
    }
    String::from_utf8_lossy(&reply).into_owned()
}

fn get(address: SocketAddr, path: &str, headers: &str) -> String {
    let host = format!("Host: {address}\r\n");
    let host = if headers.contains("Host:") { "" } else { &host };
    let headers = format!("{host}{headers}Connection: close\r\n");
    reply(address, &format!("GET {path} HTTP/1.1\r\n{headers}\r\n"))
}

fn post(address: SocketAddr, path: &str, headers: &str, body: &str) -> String {
    let length = body.len();
    let request = format!(
        "POST {path} HTTP/1.1\r\nHost: {address}\r\nContent-Length: {length}\r\nConnection: close\r\n{headers}\r\n{body}"
    );
    reply(address, &request)
}

const JSON: &str = "Content-Type: application/json\r\n";

fn status(reply: &str) -> u16 {
    let code = reply
        .split(' ')
        .nth(1)
        .unwrap_or_else(|| panic!("no reply: {reply:?}"));
    code.parse().unwrap()
}

fn socket(address: SocketAddr) -> WebSocket<TcpStream> {
    socket_at(address, "live")
}

fn socket_at(address: SocketAddr, path: &str) -> WebSocket<TcpStream> {
    let stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(30)))
        .unwrap();
    let request = format!("ws://{address}/{path}")
        .into_client_request()
        .unwrap();
    tungstenite::client(request, stream).unwrap().0
}

#[test]
fn the_page_its_files_and_requests_are_answered_with_strict_headers() {
    let (_server, address, _) = server("127.0.0.1:0");
    let page = get(address, "/", "");
    assert_eq!(status(&page), 200);
    assert!(page.contains("<title>Pardalis studio</title>"), "{page}");
    for header in [
        "content-security-policy: default-src 'none'; script-src 'self' 'nonce-",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
        "cross-origin-resource-policy: same-origin",
    ] {
        assert!(page.contains(header), "{page}");
    }
    // Only the list of modules with the nonce of this reply is part of the page.
    let nonce = page
        .split("'nonce-")
        .nth(1)
        .unwrap()
        .split('\'')
        .next()
        .unwrap();
    assert_eq!(nonce.len(), 32);
    let imports = format!("nonce=\"{nonce}\">{{\"imports\": {{\"a\": \"/extra/a.js\"}}}}</script>");
    assert!(page.contains(&imports), "{page}");
    assert!(!get(address, "/", "").contains(nonce));
    // Only the list of modules with the nonce of this reply is part of the page.
    let nonce = page.split("'nonce-").nth(1).unwrap();
    let nonce = nonce.split('\'').next().unwrap();
    assert_eq!(nonce.len(), 32);
    let imports = format!("nonce=\"{nonce}\">{{\"imports\": {{\"a\": \"/extra/a.js\"}}}}</script>");
    assert!(page.contains(&imports), "{page}");
    assert!(!get(address, "/", "").contains(nonce));
    // Other origins may read nothing.
    assert!(!page.to_lowercase().contains("access-control-allow"));
    assert!(get(address, "/extra/a.js", "").ends_with("export {};"));
    let answer = post(address, "/api/do", JSON, "[1, 2]");
    assert!(
        answer.ends_with(r#"{"request":"do","value":[1,2]}"#),
        "{answer}"
    );
    let failed = post(address, "/api/fail", JSON, "{}");
    assert_eq!(status(&failed), 422);
    assert!(
        failed.ends_with(r#"{"error":"it is wrong; do it right"}"#),
        "{failed}"
    );
    assert_eq!(status(&post(address, "/api/panic", JSON, "{}")), 500);
    assert_eq!(status(&post(address, "/api/do", JSON, "{}")), 200);
}

#[test]
fn foreign_hosts_and_origins_are_refused_everywhere() {
    let (_server, address, _) = server("127.0.0.1:0");
    for headers in [
        "Host: example.com\r\n".to_owned(),
        format!("Host: example.com:{}\r\n", address.port()),
        "Origin: http://example.com\r\n".to_owned(),
        "Origin: null\r\n".to_owned(),
        format!("Origin: http://localhost:{}\r\n", address.port()),
        "Sec-Fetch-Site: cross-site\r\n".to_owned(),
    ] {
        for path in ["/", "/app.js", "/live", "/api/do", "/missing"] {
            let refused = get(address, path, &headers);
            assert_eq!(status(&refused), 403, "{path} {headers}");
        }
        if !headers.contains("Host") {
            let refused = post(address, "/api/do", &format!("{headers}{JSON}"), "{}");
            assert_eq!(status(&refused), 403, "{headers}");
        }
    }
    // A request of HTTP/1.0 needs no host.
    assert_eq!(status(&reply(address, "GET / HTTP/1.0\r\n\r\n")), 403);
}

#[test]
fn a_websocket_of_another_page_is_refused() {
    let (_server, address, _) = server("127.0.0.1:0");
    let mut request = format!("ws://{address}/live")
        .into_client_request()
        .unwrap();
    let origin = "http://example.com".parse().unwrap();
    request.headers_mut().insert("origin", origin);
    let stream = TcpStream::connect(address).unwrap();
    let refused = tungstenite::client(request, stream).unwrap_err();
    assert!(refused.to_string().contains("403"), "{refused}");
}

#[test]
fn beyond_this_computer_everything_needs_the_token() {
    let (server, address, _) = server("0.0.0.0:0");
    let (_, token) = server.address().split_once("?token=").unwrap();
    assert_eq!(token.len(), 32);
    let wrong = format!("Authorization: Bearer {}\r\n", "0".repeat(32));
    for headers in ["", &wrong, "Cookie: a=b\r\n"] {
        for path in ["/", "/?token=", "/?token=0", "/app.js", "/live", "/missing"] {
            assert_eq!(
                status(&get(address, path, headers)),
                401,
                "{path} {headers}"
            );
        }
        let refused = post(address, "/api/do", &format!("{headers}{JSON}"), "{}");
        assert_eq!(status(&refused), 401, "{headers}");
    }
    let opened = get(address, &format!("/?token={token}"), "");
    assert_eq!(status(&opened), 303);
    let cookie = opened
        .lines()
        .find_map(|line| line.strip_prefix("set-cookie: "));
    let cookie = cookie.unwrap();
    assert!(
        cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict"),
        "{cookie}"
    );
    let cookie = format!("Cookie: {}\r\n", cookie.split(';').next().unwrap());
    assert_eq!(status(&get(address, "/app.js", &cookie)), 200);
    let answer = post(address, "/api/do", &format!("{cookie}{JSON}"), "{}");
    assert_eq!(status(&answer), 200);
    // With the token, but from another page.
    let foreign = format!("{cookie}Origin: http://example.com\r\n");
    assert_eq!(status(&get(address, "/app.js", &foreign)), 403);
}

#[test]
fn there_are_no_files_but_those_of_the_page() {
    let (_server, address, _) = server("127.0.0.1:0");
    for path in [
        "/../Cargo.toml",
        "/..%2fCargo.toml",
        "/%2e%2e/%2e%2e/etc/passwd",
        "//etc/passwd",
        "/steps/../../src/lib.rs",
        "/app.js/",
        "/App.js",
    ] {
        assert_eq!(status(&get(address, path, "")), 404, "{path}");
    }
    let other = post(address, "/app.js", JSON, "{}");
    assert_eq!(status(&other), 405);
}

#[test]
fn malformed_and_oversized_requests_are_refused() {
    let (_server, address, _) = server("127.0.0.1:0");
    for body in ["", "{", "NaN", "{\"a\": 1e}", "\u{0}"] {
        let refused = post(address, "/api/do", JSON, body);
        assert_eq!(status(&refused), 400, "{body:?}");
        assert!(refused.contains("the body is no JSON"), "{refused}");
    }
    let deep = "[".repeat(100_000);
    assert_eq!(status(&post(address, "/api/do", JSON, &deep)), 400);
    for kind in [
        "",
        "Content-Type: text/plain\r\n",
        "Content-Type: application/x-www-form-urlencoded\r\n",
    ] {
        assert_eq!(status(&post(address, "/api/do", kind, "{}")), 415, "{kind}");
    }
    let huge = format!("\"{}\"", "a".repeat(2 << 20));
    assert_eq!(status(&post(address, "/api/do", JSON, &huge)), 413);
    // Headers without an end, and what is no HTTP.
    let long = format!("X: {}\r\n", "a".repeat(1 << 20));
    assert_eq!(status(&get(address, "/", &long)), 431);
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .write_all(b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03")
        .unwrap();
    let mut reply = String::new();
    let _ = stream.read_to_string(&mut reply);
    assert_eq!(status(&reply), 400);
    assert_eq!(status(&get(address, "/", "")), 200);
}

#[test]
fn a_page_gets_what_is_latest_when_it_asks() {
    let (_server, address, feed) = server("127.0.0.1:0");
    let mut page = socket(address);
    for number in 0..100 {
        feed.show("a", &json!(number));
    }
    feed.show_image("b", &json!({"index": 7}), &[1, 2, 3]);
    page.send(Message::text("more")).unwrap();
    let text = page.read().unwrap();
    let value: Value = serde_json::from_str(text.to_text().unwrap()).unwrap();
    assert_eq!(value, json!({"topic": "a", "sequence": 100, "value": 99}));
    let Message::Binary(image) = page.read().unwrap() else {
        panic!("no image")
    };
    let length = u32::from_be_bytes(image[..4].try_into().unwrap()) as usize;
    let head: Value = serde_json::from_slice(&image[4..4 + length]).unwrap();
    assert_eq!(
        head,
        json!({"topic": "b", "sequence": 1, "value": {"index": 7}})
    );
    assert_eq!(&image[4 + length..], [1, 2, 3]);
    assert_eq!(page.read().unwrap(), Message::text("end"));
    // Nothing more comes before the page asks again, however much is shown.
    feed.show("a", &json!("x"));
    feed.show("a", &json!("y"));
    page.send(Message::text("more")).unwrap();
    let text = page.read().unwrap();
    assert!(
        text.to_text()
            .unwrap()
            .contains(r#""sequence":102,"topic":"a","value":"y""#),
        "{text}"
    );
    assert_eq!(page.read().unwrap(), Message::text("end"));
}

/// Reads the next line of a reader of lines.
fn next_line(socket: &mut WebSocket<TcpStream>) -> Value {
    loop {
        match socket.read().unwrap() {
            Message::Text(text) => {
                assert!(text.ends_with("}\n"), "{text}");
                return serde_json::from_str(&text).unwrap();
            }
            Message::Ping(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn readers_get_new_lines_unasked_and_know_how_many_they_missed() {
    let lines = Lines::default();
    let (_server, address, _) = server_with("127.0.0.1:0", lines.clone());
    lines.send("{\"n\":0".to_owned());
    assert!(!lines.are_read());
    let mut quick = socket_at(address, "lines");
    let mut slow = socket_at(address, "lines");
    assert!(lines.are_read());
    // What was sent before they came is not theirs, and not dropped.
    lines.send("{\"n\":1".to_owned());
    for reader in [&mut quick, &mut slow] {
        assert_eq!(next_line(reader), json!({"n": 1, "dropped": 0}));
    }
    // More than any buffer of the system holds, to somebody who does not read.
    let filling = "x".repeat(1 << 20);
    for number in 2..=40 {
        lines.send(format!("{{\"n\":{number},\"filling\":\"{filling}\""));
        let line = next_line(&mut quick);
        assert_eq!(
            (&line["n"], &line["dropped"]),
            (&json!(number), &json!(0)),
            "the quick reader"
        );
    }
    let mut got = vec![1];
    while got.last() != Some(&40) {
        let line = next_line(&mut slow);
        got.push(line["n"].as_u64().unwrap());
        let so_far = got.len() as u64;
        assert_eq!(line["dropped"], got[got.len() - 1] - so_far);
    }
    assert!(got.len() < 40, "{got:?}");
}

#[test]
fn a_page_that_breaks_the_rules_is_cut_off() {
    let (_server, address, feed) = server("127.0.0.1:0");
    for message in [
        Message::text("less"),
        Message::text("a".repeat(1 << 16)),
        Message::binary(vec![0; 10]),
    ] {
        let mut page = socket(address);
        // It may be cut off while it still sends.
        let _ = page.send(message.clone());
        let end = std::iter::repeat_with(|| page.read())
            .find(|read| !matches!(read, Ok(Message::Ping(_))));
        let is_end = matches!(end, Some(Err(_) | Ok(Message::Close(_))));
        assert!(is_end, "{message:?}: {end:?}");
    }
    // Pages are gone for the feed, too, which a moment may take.
    for _ in 0..200 {
        if !feed.is_watched() {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    assert!(!feed.is_watched());
}

#[test]
fn a_thousand_idle_connections_are_bounded_and_do_not_disturb_an_open_page() {
    let (_server, address, feed) = server("127.0.0.1:0");
    let mut page = socket(address);
    let idle: Vec<TcpStream> = (0..1000)
        .filter_map(|_| TcpStream::connect(address).ok())
        .collect();
    assert!(idle.len() > 500, "{}", idle.len());
    feed.show("a", &json!(1));
    page.send(Message::text("more")).unwrap();
    assert!(
        page.read()
            .unwrap()
            .to_text()
            .unwrap()
            .contains(r#""value":1"#)
    );
    // Those above the limit are closed at once.
    let is_closed = |mut stream: &TcpStream| {
        stream
            .set_read_timeout(Some(Duration::from_secs(2)))
            .unwrap();
        matches!(stream.read(&mut [0]), Ok(0) | Err(_)) && {
            stream.set_nonblocking(true).unwrap();
            !matches!(stream.read(&mut [0]), Err(error) if error.kind() == ErrorKind::WouldBlock)
        }
    };
    assert!(is_closed(idle.last().unwrap()));
    let closed = idle
        .iter()
        .skip(200)
        .filter(|stream| is_closed(stream))
        .count();
    assert_eq!(closed, idle.len() - 200);
    drop(idle);
    // New pages are served once there is room again.
    for _ in 0..200 {
        if get_ok(address) {
            return;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    panic!("no page is served any more");
}

fn get_ok(address: SocketAddr) -> bool {
    let Ok(mut stream) = TcpStream::connect(address) else {
        return false;
    };
    let request = format!("GET / HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    let mut reply = String::new();
    stream.write_all(request.as_bytes()).is_ok()
        && stream.read_to_string(&mut reply).is_ok()
        && reply.contains(" 200 ")
}

#[test]
fn a_server_ends_when_it_is_dropped() {
    let (server, address, _) = server("127.0.0.1:0");
    let mut page = socket(address);
    drop(server);
    assert!(page.read().is_err());
    assert!(TcpStream::connect(address).is_err());
}
