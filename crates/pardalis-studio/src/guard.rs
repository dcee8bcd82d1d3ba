//! Which requests are answered.
//!
//! Pages of other sites can send requests to this computer through the user's browser. They cannot forge `Host`, `Origin` and `Sec-Fetch-Site`, and
//! cannot read replies, since nothing is shared across origins. Whoever reaches a server that listens to more than this computer needs the token.

use std::net::{IpAddr, SocketAddr};

use axum::http::{HeaderMap, StatusCode, header};

/// Decides which requests are answered.
#[derive(Debug)]
pub(crate) struct Guard {
    address: SocketAddr,
    /// What every request must carry; `None` if only this computer reaches the server.
    token: Option<String>,
}

/// Why a request is not answered.
pub(crate) type Refusal = (StatusCode, String);

impl Guard {
    /// Guards a server at this address.
    ///
    /// Errors: the system has no random numbers for the token.
    pub(crate) fn of(address: SocketAddr) -> std::io::Result<Self> {
        let token = if address.ip().is_loopback() {
            None
        } else {
            Some(random()?)
        };
        Ok(Self { address, token })
    }

    /// Returns what follows the address of the page when it is opened.
    pub(crate) fn query(&self) -> String {
        self.token
            .as_ref()
            .map_or_else(String::new, |token| format!("?token={token}"))
    }

    /// Returns the cookie of a page that was opened with the right token in its query.
    pub(crate) fn cookie_for(&self, query: Option<&str>) -> Option<String> {
        let token = self.token.as_ref()?;
        let given = query?.strip_prefix("token=")?;
        let name = self.cookie_name();
        is_same(given, token).then(|| format!("{name}={token}; Path=/; HttpOnly; SameSite=Strict"))
    }

    /// Checks a request by its headers.
    pub(crate) fn check(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        self.check_origin(headers)?;
        match &self.token {
            Some(token) if !self.has_token(headers, token) => Err((
                StatusCode::UNAUTHORIZED,
                "the token is missing or wrong; open the address that the program printed, or send its token in a header: Authorization: Bearer TOKEN"
                    .to_owned(),
            )),
            _ => Ok(()),
        }
    }

    /// Checks that a request is for this server, and from its own page or from no page.
    pub(crate) fn check_origin(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        let refused = |what: &str| {
            let port = self.address.port();
            let remedy =
                format!("open http://127.0.0.1:{port}/, or the address that the program printed");
            Err((StatusCode::FORBIDDEN, format!("{what}; {remedy}")))
        };
        let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let Some(host) = text(header::HOST).filter(|host| self.is_own(host)) else {
            return refused("the request is for another host");
        };
        let is_foreign = |origin: &str| origin.strip_prefix("http://") != Some(host);
        if text(header::ORIGIN).is_some_and(is_foreign) {
            return refused("the request comes from a page of another site");
        }
        let site = headers.get("sec-fetch-site");
        if site.is_some_and(|site| site != "same-origin" && site != "none") {
            return refused("the request comes from a page of another site");
        }
        Ok(())
    }

    /// Reports whether a `Host` names this server by a number or as this computer. A name could be one of another site that leads here.
    fn is_own(&self, host: &str) -> bool {
        let port = self.address.port();
        let Some(name) = host.strip_suffix(&format!(":{port}")) else {
            return false;
        };
        let number = name.trim_start_matches('[').trim_end_matches(']');
        match number.parse::<IpAddr>() {
            Ok(ip) => {
                ip == self.address.ip() || self.address.ip().is_unspecified() || ip.is_loopback()
            }
            Err(_) => name == "localhost",
        }
    }

    fn has_token(&self, headers: &HeaderMap, token: &str) -> bool {
        let cookies = headers.get_all(header::COOKIE).iter();
        let mut pairs = cookies
            .filter_map(|value| value.to_str().ok())
            .flat_map(|value| value.split(';'))
            .filter_map(|pair| pair.trim().split_once('='));
        let name = self.cookie_name();
        let bearer = headers.get(header::AUTHORIZATION);
        let bearer = bearer.and_then(|value| value.to_str().ok()?.strip_prefix("Bearer "));
        pairs.any(|(key, value)| key == name && is_same(value, token))
            || bearer.is_some_and(|given| is_same(given, token))
    }

    /// Returns the name of the cookie. Cookies are shared by all ports of a host.
    fn cookie_name(&self) -> String {
        format!("pardalis-{}", self.address.port())
    }
}

/// Returns a text that nobody can guess.
///
/// Errors: the system has no random numbers.
pub(crate) fn random() -> std::io::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(format!("{:032x}", u128::from_le_bytes(bytes)))
}

/// Compares in a time that does not depend on where texts of the same length differ.
fn is_same(given: &str, token: &str) -> bool {
    let differences = given.bytes().zip(token.bytes()).map(|(a, b)| a ^ b);
    given.len() == token.len() && differences.fold(0, |all, one| all | one) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard(address: &str) -> Guard {
        Guard::of(address.parse().unwrap()).unwrap()
    }

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = pairs
            .iter()
            .map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap()));
        pairs.collect()
    }

    #[test]
    fn only_the_page_itself_is_answered() {
        let guard = guard("127.0.0.1:4000");
        for accepted in [
            &[("host", "127.0.0.1:4000")][..],
            &[("host", "localhost:4000")],
            &[("host", "[::1]:4000")],
            &[
                ("host", "127.0.0.1:4000"),
                ("origin", "http://127.0.0.1:4000"),
            ],
            &[
                ("host", "localhost:4000"),
                ("sec-fetch-site", "same-origin"),
            ],
            &[("host", "localhost:4000"), ("sec-fetch-site", "none")],
        ] {
            assert!(guard.check(&headers(accepted)).is_ok(), "{accepted:?}");
        }
        for refused in [
            &[][..],
            &[("host", "127.0.0.1")],
            &[("host", "127.0.0.1:4001")],
            &[("host", "192.168.1.7:4000")],
            &[("host", "example.com:4000")],
            &[("host", "localhost.example.com:4000")],
            &[("host", "127.0.0.1:4000"), ("origin", "http://example.com")],
            &[("host", "127.0.0.1:4000"), ("origin", "null")],
            &[
                ("host", "127.0.0.1:4000"),
                ("origin", "http://127.0.0.1:4001"),
            ],
            &[
                ("host", "127.0.0.1:4000"),
                ("origin", "https://127.0.0.1:4000"),
            ],
            &[
                ("host", "127.0.0.1:4000"),
                ("origin", "http://localhost:4000"),
            ],
            &[("host", "127.0.0.1:4000"), ("sec-fetch-site", "cross-site")],
            &[("host", "127.0.0.1:4000"), ("sec-fetch-site", "same-site")],
        ] {
            let (status, message) = guard.check(&headers(refused)).unwrap_err();
            assert_eq!(status, StatusCode::FORBIDDEN, "{refused:?}");
            assert!(message.contains("open http://127.0.0.1:4000/"), "{message}");
        }
    }

    #[test]
    fn beyond_this_computer_every_request_needs_the_token() {
        let guard = guard("0.0.0.0:4000");
        let token = guard.token.clone().unwrap();
        assert_eq!(token.len(), 32);
        assert_ne!(token, self::guard("0.0.0.0:4000").token.unwrap());
        let query = guard.query();
        let cookie = guard.cookie_for(query.strip_prefix('?')).unwrap();
        let cookie = cookie.split(';').next().unwrap();
        let host = ("host", "192.168.1.7:4000");
        let others = format!("a=b; {cookie}");
        let bearer = format!("Bearer {token}");
        for pair in [("cookie", &others), ("authorization", &bearer)] {
            let accepted = headers(&[host, (pair.0, pair.1)]);
            assert!(guard.check(&accepted).is_ok(), "{pair:?}");
        }
        let wrong = format!("pardalis-4000={}", token.replace(&token[31..], "x"));
        let short = format!("Bearer {}", &token[1..]);
        let other_port = format!("pardalis-4001={token}");
        for pairs in [
            &[host][..],
            &[host, ("cookie", &wrong)],
            &[host, ("cookie", &other_port)],
            &[host, ("cookie", "pardalis-4000=")],
            &[host, ("authorization", &short)],
        ] {
            let (status, _) = guard.check(&headers(pairs)).unwrap_err();
            assert_eq!(status, StatusCode::UNAUTHORIZED, "{pairs:?}");
        }
        // The token does not excuse a foreign page, nor a name that leads here.
        for pair in [
            ("origin", "http://example.com"),
            ("host", "example.com:4000"),
        ] {
            let mut foreign = headers(&[host, ("authorization", &bearer)]);
            foreign.insert(pair.0, pair.1.parse().unwrap());
            let (status, _) = guard.check(&foreign).unwrap_err();
            assert_eq!(status, StatusCode::FORBIDDEN);
        }
        assert_eq!(guard.cookie_for(Some("token=0")), None);
        assert_eq!(guard.cookie_for(None), None);
    }
}
