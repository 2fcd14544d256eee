//! Access control: host and origin checks for loopback servers, a token for all others.
//!
//! On the loopback interface, only requests to its host names and from the page's own origin are
//! answered. Elsewhere a token is required; it follows the `#` of the address, appears in no log,
//! and stays in the tab. No settings file opens a port.

use crate::ViewerError;
use axum::http::{
    HeaderMap, Uri, header,
    uri::{Authority, Port},
};
use core::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use subtle::ConstantTimeEq;

/// Header of the access token.
const TOKEN_HEADER: &str = "x-specula-token";
/// Header in which browsers state the relation of the requesting site to this one.
const FETCH_SITE: &str = "sec-fetch-site";
/// Accepted relations: requests of the page itself, and of typed addresses.
const ACCEPTED_SITES: [&[u8]; 2] = [b"same-origin", b"none"];
/// Random bytes of a generated token.
const TOKEN_LEN: usize = 16;

/// Reason why a request is denied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Denied {
    /// The host is not a name of the loopback interface, as in a DNS rebinding attack.
    Host,
    /// The request comes from another site.
    Origin,
    /// The token is missing or wrong.
    Token,
}

impl Denied {
    /// Message for the client.
    pub(crate) fn message(self) -> &'static str {
        match self {
            Self::Host => "this page is served only to localhost; open it as http://localhost:PORT/",
            Self::Origin => "requests from other sites are denied",
            Self::Token => "the token is missing or wrong; open the whole address that was printed",
        }
    }
}

/// Conditions that requests must meet.
#[derive(Clone, Debug)]
pub(crate) struct Guard {
    /// Token of all requests except those for files of the page; `None` on the loopback interface.
    token: Option<String>,
}

impl Guard {
    /// Guard of a server at an address. Without a chosen token, servers beyond the loopback
    /// interface get a random one.
    pub(crate) fn new(address: IpAddr, chosen: Option<&str>) -> Result<Self, ViewerError> {
        let token = match chosen {
            Some(token) => Some(token.to_owned()),
            None if address.is_loopback() => None,
            None => Some(random_token()?),
        };
        Ok(Self { token })
    }

    /// Access token, if one is needed.
    pub(crate) fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// Checks the headers of a request. `is_page` is true for files of the page, which contain
    /// nothing of the scene and need no token.
    pub(crate) fn check(&self, headers: &HeaderMap, is_page: bool) -> Result<(), Denied> {
        let host = text(headers, header::HOST.as_str()).and_then(authority);
        if self.token.is_none() && !host.as_ref().is_some_and(is_loopback) {
            return Err(Denied::Host);
        }
        if text(headers, header::ORIGIN.as_str()).is_some_and(|origin| !is_origin_of(origin, host.as_ref())) {
            return Err(Denied::Origin);
        }
        if is_page {
            return Ok(());
        }
        if headers.get(FETCH_SITE).is_some_and(|site| !ACCEPTED_SITES.contains(&site.as_bytes())) {
            return Err(Denied::Origin);
        }
        match &self.token {
            Some(token) if !headers.get(TOKEN_HEADER).is_some_and(|given| is_equal(token, given.as_bytes())) => {
                Err(Denied::Token)
            }
            _ => Ok(()),
        }
    }
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

/// Parses a host with an optional port; `None` for other text.
fn authority(text: &str) -> Option<Authority> {
    let authority: Authority = text.parse().ok()?;
    let rest = text.strip_prefix(authority.host())?;
    let port = authority.port();
    let is_whole = match rest.strip_prefix(':') {
        Some(digits) => port.as_ref().map(Port::as_str) == Some(digits),
        None => rest.is_empty(),
    };
    is_whole.then_some(authority)
}

/// Whether a host is a name of the loopback interface.
fn is_loopback(host: &Authority) -> bool {
    let host = host.host();
    match host.strip_prefix('[').and_then(|host| host.strip_suffix(']')) {
        Some(address) => address.parse().is_ok_and(|address: Ipv6Addr| address.is_loopback()),
        None => {
            host.eq_ignore_ascii_case("localhost") || host.parse().is_ok_and(|address: Ipv4Addr| address.is_loopback())
        }
    }
}

/// Whether an origin such as `http://localhost:7008` has this host and port.
fn is_origin_of(origin: &str, host: Option<&Authority>) -> bool {
    let origin = origin.parse::<Uri>().ok().filter(|origin| origin.scheme().is_some());
    origin.is_some_and(|origin| origin.authority().is_some() && origin.authority() == host)
}

/// Compares a token in constant time.
fn is_equal(token: &str, given: &[u8]) -> bool {
    token.as_bytes().ct_eq(given).into()
}

fn random_token() -> Result<String, ViewerError> {
    let mut bytes = [0; TOKEN_LEN];
    getrandom::fill(&mut bytes).map_err(ViewerError::Random)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOPBACK: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);
    const ANYWHERE: IpAddr = IpAddr::V4(Ipv4Addr::UNSPECIFIED);

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.parse().unwrap(), value.parse().unwrap())).collect()
    }

    #[test]
    fn only_names_of_the_loopback_interface_are_accepted() {
        let guard = Guard::new(LOOPBACK, None).unwrap();
        for host in ["localhost", "localhost:7008", "LOCALHOST:1", "127.0.0.1:7008", "[::1]:7008", "127.1.2.3"] {
            assert_eq!(guard.check(&headers(&[("host", host)]), false), Ok(()), "{host}");
        }
        for host in [
            "evil.example",
            "evil.example:7008",
            "192.168.0.2:7008",
            "localhost.evil.example",
            "[::1].evil.example",
            "[::1].evil.example:7008",
            "[::1]7008",
            "[localhost]",
            "localhost:evil.com",
            "localhost:",
            "localhost:99999",
            "localhost:7008:7008",
            "localhost:7008/x",
            "evil.example@localhost",
            "::1",
            "[::2]",
            "",
        ] {
            for is_page in [false, true] {
                assert_eq!(guard.check(&headers(&[("host", host)]), is_page), Err(Denied::Host), "{host}");
            }
        }
        assert_eq!(guard.check(&headers(&[]), true), Err(Denied::Host), "no host at all");
    }

    #[test]
    fn requests_from_other_sites_are_denied() {
        let guard = Guard::new(LOOPBACK, None).unwrap();
        let from = |origin| headers(&[("host", "localhost:7008"), ("origin", origin)]);
        assert_eq!(guard.check(&from("http://localhost:7008"), false), Ok(()));
        for origin in ["http://evil.example", "http://localhost:80", "null", "localhost:7008"] {
            assert_eq!(guard.check(&from(origin), false), Err(Denied::Origin), "{origin}");
        }
        for (site, expected) in [
            ("same-origin", Ok(())),
            ("none", Ok(())),
            ("same-site", Err(Denied::Origin)),
            ("cross-site", Err(Denied::Origin)),
            ("", Err(Denied::Origin)),
        ] {
            let sent = headers(&[("host", "localhost"), ("sec-fetch-site", site)]);
            assert_eq!(guard.check(&sent, false), expected, "{site}");
            assert_eq!(guard.check(&sent, true), Ok(()), "a link from {site} opens the page");
        }
    }

    #[test]
    fn other_addresses_need_a_token() {
        let guard = Guard::new(ANYWHERE, None).unwrap();
        let token = guard.token().unwrap().to_owned();
        assert_eq!(token.len(), 2 * TOKEN_LEN);
        assert_ne!(token, Guard::new(ANYWHERE, None).unwrap().token().unwrap(), "every server has its own");
        let with = |token: &str| headers(&[("host", "192.168.0.2:7008"), (TOKEN_HEADER, token)]);
        assert_eq!(guard.check(&with(&token), false), Ok(()));
        for wrong in
            ["", "x", &token[1..], &token[..token.len() - 1], &token.replace(|_| true, "x"), &format!("{token}0")]
        {
            assert_eq!(guard.check(&with(wrong), false), Err(Denied::Token), "{wrong}");
        }
        for index in 0..token.len() {
            let mut wrong = token.clone();
            wrong.replace_range(index..=index, "x");
            assert_eq!(guard.check(&with(&wrong), false), Err(Denied::Token), "every letter counts, as the {index}th");
        }
        assert_eq!(guard.check(&headers(&[("host", "192.168.0.2")]), true), Ok(()), "the page holds no secret");
    }
}
