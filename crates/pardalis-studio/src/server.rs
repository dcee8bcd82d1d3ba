//! The server: connections, requests and replies, all within limits.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use std::{io, thread};

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::extract::{FromRequestParts, Path, Request, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use serde_json::{Value, json};
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, oneshot};
use tokio::time::timeout;

use crate::assets::{Asset, FILES, PAGE};
use crate::feed::Feed;
use crate::guard::{Guard, Refusal, random};
use crate::lines::{self, Lines};
use crate::live::{self, MAX_MESSAGE_BYTES};

/// The most connections at a time; further ones are closed at once.
const MAX_CONNECTIONS: usize = 128;
/// The most pages and readers of lines at a time.
const MAX_SOCKETS: usize = 16;
/// The most requests that the program answers at a time.
const MAX_REQUESTS: usize = 8;
/// The longest body of a request, in bytes.
const MAX_BODY_BYTES: usize = 1 << 20;
/// How long the head or the body of a request may take, and how long a connection may be idle.
const PATIENCE: Duration = Duration::from_secs(10);

/// What a page may do: it loads nothing from elsewhere, runs no code but its own and is in no frame of others. `NONCE` stands for a text that nobody knows
/// before, which marks the list of its modules as its own.
const POLICY: &str = "default-src 'none'; script-src 'self' 'nonce-NONCE'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
     base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Further headers of every reply.
const HEADERS: [(HeaderName, &str); 5] = [
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
];

/// What answers the requests of the page.
pub trait Program: Send + Sync + 'static {
    /// Answers a request by its name, on a thread that may wait.
    ///
    /// Errors: what is wrong and how to correct it, in words for the user.
    fn answer(&self, request: &str, value: Value) -> Result<Value, String>;
}

/// A running server; dropping it ends it.
pub struct Server {
    address: String,
    lines: Lines,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<thread::JoinHandle<()>>,
}

/// What a server has in addition to its own page.
#[derive(Debug, Default)]
pub struct Extension {
    /// Further files.
    pub assets: Vec<Asset>,
    /// The import map of the page, in JSON; empty for none.
    pub import_map: String,
    /// What other programs read at `/lines`.
    pub lines: Lines,
}

struct Shared {
    guard: Guard,
    assets: BTreeMap<String, Asset>,
    /// The page, in which `{{nonce}}` is to be replaced.
    page: String,
    program: Arc<dyn Program>,
    feed: Feed,
    lines: Lines,
    requests: Semaphore,
    sockets: Arc<Semaphore>,
}

type App = State<Arc<Shared>>;

impl Server {
    /// Starts a server at an address; port 0 stands for any that is free.
    ///
    /// Errors: the address cannot be used.
    pub fn start(
        listen: SocketAddr,
        program: Arc<dyn Program>,
        feed: Feed,
        extension: Extension,
    ) -> io::Result<Self> {
        let listener = std::net::TcpListener::bind(listen)?;
        listener.set_nonblocking(true)?;
        let guard = Guard::of(listener.local_addr()?)?;
        let address = format!("http://{}/{}", listener.local_addr()?, guard.query());
        let assets = FILES.iter().cloned().chain(extension.assets);
        let imports = match &*extension.import_map {
            "" => "{}",
            imports => imports,
        };
        let lines = extension.lines.clone();
        let shared = Shared {
            guard,
            assets: assets
                .map(|asset| (asset.path.to_string(), asset))
                .collect(),
            page: PAGE.replace("{{imports}}", imports),
            program,
            feed,
            lines: extension.lines,
            requests: Semaphore::new(MAX_REQUESTS),
            sockets: Arc::new(Semaphore::new(MAX_SOCKETS)),
        };
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()?;
        let (stop, stopped) = oneshot::channel();
        let thread = thread::Builder::new()
            .name("studio".to_owned())
            .spawn(move || {
                runtime.block_on(async {
                    tokio::select! {
                        () = accept(listener, router(shared)) => {}
                        _ = stopped => {}
                    }
                });
                // Requests that wait for a camera end with the program.
                runtime.shutdown_background();
            })?;
        Ok(Self {
            address,
            lines,
            stop: Some(stop),
            thread: Some(thread),
        })
    }

    /// Returns the address of the page, with the token if one is needed.
    pub fn address(&self) -> &str {
        &self.address
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.lines.end();
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            // A panic has been reported, and there is nothing left to serve.
            let _ = thread.join();
        }
    }
}

/// Takes connections, as many at a time as are allowed.
async fn accept(listener: std::net::TcpListener, router: Router) {
    let Ok(listener) = TcpListener::from_std(listener) else {
        return;
    };
    let slots = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            // Too many open files, most likely.
            tokio::time::sleep(Duration::from_millis(50)).await;
            continue;
        };
        let Ok(slot) = Arc::clone(&slots).try_acquire_owned() else {
            continue;
        };
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let mut http = http1::Builder::new();
            http.timer(TokioTimer::new()).header_read_timeout(PATIENCE);
            let connection = http.serve_connection(TokioIo::new(stream), service);
            // What went wrong is the client's affair.
            let _ = connection.with_upgrades().await;
            drop(slot);
        });
    }
}

fn router(shared: Shared) -> Router {
    let shared = Arc::new(shared);
    Router::new()
        .route("/api/{request}", post(request))
        .route("/live", get(page_socket))
        .route("/lines", get(lines_socket))
        .fallback(get(file))
        .layer(middleware::from_fn_with_state(Arc::clone(&shared), guarded))
        .with_state(shared)
}

/// Answers what the guard allows.
async fn guarded(State(shared): App, request: Request, next: Next) -> Response {
    let mut response = match shared.guard.check_origin(request.headers()) {
        Err(refusal) => refused(refusal),
        Ok(()) => match shared.guard.cookie_for(request.uri().query()) {
            Some(cookie) if request.uri().path() == "/" => {
                let to_page = [(header::LOCATION, "/"), (header::SET_COOKIE, &*cookie)];
                (StatusCode::SEE_OTHER, to_page).into_response()
            }
            _ => match shared.guard.check(request.headers()) {
                Err(refusal) => refused(refusal),
                Ok(()) => next.run(request).await,
            },
        },
    };
    let headers = response.headers_mut();
    for (name, value) in HEADERS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    // The page has one of its own.
    headers
        .entry(header::CONTENT_SECURITY_POLICY)
        .or_insert(HeaderValue::from_static(
            "default-src 'none'; frame-ancestors 'none'",
        ));
    response
}

fn refused((status, message): Refusal) -> Response {
    let kind = [(header::CONTENT_TYPE, "application/json")];
    (status, kind, json!({ "error": message }).to_string()).into_response()
}

/// Serves a file of the page.
async fn file(State(shared): App, request: Request) -> Response {
    if request.uri().path() == "/" {
        return page(&shared);
    }
    match shared
        .assets
        .get(request.uri().path().trim_start_matches('/'))
    {
        Some(asset) => ([(header::CONTENT_TYPE, asset.content_type)], asset.bytes).into_response(),
        None => refused((
            StatusCode::NOT_FOUND,
            "there is no such page; lines for other programs are at /lines".to_owned(),
        )),
    }
}

fn page(shared: &Shared) -> Response {
    let Ok(nonce) = random() else {
        return StatusCode::INTERNAL_SERVER_ERROR.into_response();
    };
    let headers = [
        (header::CONTENT_TYPE, "text/html; charset=utf-8".to_owned()),
        (
            header::CONTENT_SECURITY_POLICY,
            POLICY.replace("NONCE", &nonce),
        ),
    ];
    (headers, shared.page.replace("{{nonce}}", &nonce)).into_response()
}

/// Passes a request on to the program.
async fn request(State(shared): App, Path(name): Path<String>, request: Request) -> Response {
    match answered(&shared, name, request).await {
        Ok(value) => {
            let kind = [(header::CONTENT_TYPE, "application/json")];
            (kind, value.to_string()).into_response()
        }
        Err(refusal) => refused(refusal),
    }
}

async fn answered(shared: &Shared, name: String, request: Request) -> Result<Value, Refusal> {
    let kind = request.headers().get(header::CONTENT_TYPE);
    // Pages of other sites cannot send this type without asking first.
    if kind.is_none_or(|kind| kind != "application/json") {
        let what = "the body must be of the type application/json";
        return Err((StatusCode::UNSUPPORTED_MEDIA_TYPE, what.to_owned()));
    }
    let body = read(request.into_body()).await?;
    let value = serde_json::from_slice(&body).map_err(|error| {
        let what = format!("the body is no JSON: {error}");
        (StatusCode::BAD_REQUEST, what)
    })?;
    let Ok(_slot) = shared.requests.try_acquire() else {
        let what = "too many requests at a time; wait for those before";
        return Err((StatusCode::SERVICE_UNAVAILABLE, what.to_owned()));
    };
    let program = Arc::clone(&shared.program);
    let answer = tokio::task::spawn_blocking(move || program.answer(&name, value));
    match answer.await {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(message)) => Err((StatusCode::UNPROCESSABLE_ENTITY, message)),
        Err(_) => Err((
            StatusCode::INTERNAL_SERVER_ERROR,
            "the program failed at this; its message is on the terminal, please report it"
                .to_owned(),
        )),
    }
}

async fn read(body: Body) -> Result<axum::body::Bytes, Refusal> {
    let too_long = format!("the body has more than {MAX_BODY_BYTES} bytes, or was cut off");
    match timeout(PATIENCE, to_bytes(body, MAX_BODY_BYTES)).await {
        Ok(Ok(body)) => Ok(body),
        Ok(Err(_)) => Err((StatusCode::PAYLOAD_TOO_LARGE, too_long)),
        Err(_) => Err((
            StatusCode::REQUEST_TIMEOUT,
            "the body did not arrive in time".to_owned(),
        )),
    }
}

/// Opens the WebSocket of a page.
async fn page_socket(State(shared): App, request: Request) -> Response {
    let feed = shared.feed.clone();
    open_socket(&shared, request, |socket| live::serve(socket, feed)).await
}

/// Opens the WebSocket of a program that reads lines.
async fn lines_socket(State(shared): App, request: Request) -> Response {
    let reader = shared.lines.reader();
    open_socket(&shared, request, |socket| lines::serve(socket, reader)).await
}

/// Opens a WebSocket, as many at a time as are allowed, and serves it.
async fn open_socket<F: Future<Output = ()> + Send + 'static>(
    shared: &Shared,
    request: Request,
    serve: impl FnOnce(WebSocket) -> F + Send + 'static,
) -> Response {
    let (mut parts, _) = request.into_parts();
    let upgrade = match WebSocketUpgrade::from_request_parts(&mut parts, &()).await {
        Ok(upgrade) => upgrade,
        Err(rejection) => return rejection.into_response(),
    };
    let Ok(slot) = Arc::clone(&shared.sockets).try_acquire_owned() else {
        let what = "too many pages and readers are open; close some";
        return refused((StatusCode::SERVICE_UNAVAILABLE, what.to_owned()));
    };
    upgrade
        .max_message_size(MAX_MESSAGE_BYTES)
        .max_frame_size(MAX_MESSAGE_BYTES)
        .on_upgrade(async move |socket| {
            serve(socket).await;
            drop(slot);
        })
}
