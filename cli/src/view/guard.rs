//! Who may ask: on this machine whoever opens the page itself, from elsewhere whoever has the token.

use crate::failure::Failure;
use axum::http::{HeaderMap, Uri, header};
use core::net::IpAddr;

/// The header with the token.
const TOKEN: &str = "x-specula-token";
/// Bytes of a token that nobody guesses.
const TOKEN_LEN: usize = 16;

/// Why a request is not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Denied {
    /// The page was asked for under another name, as by a page that wants to reach into this machine.
    Host,
    /// It comes from another site.
    Origin,
    /// It lacks the token.
    Token,
}

impl Denied {
    pub(super) fn sentence(self) -> &'static str {
        match self {
            Self::Host => "this page is served to localhost alone; open it as http://localhost:PORT/",
            Self::Origin => "another site may not ask this one",
            Self::Token => "the token is missing or wrong; open the whole address that specula printed",
        }
    }
}

/// What is asked of requests.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    /// Asked of all requests but those for the page itself.
    token: Option<String>,
}

impl Guard {
    /// For a server at this address: on the loopback device no token is needed, unless one is asked for.
    pub(super) fn new(address: IpAddr, asked: Option<&str>) -> Result<Self, Failure> {
        let token = match asked {
            Some(token) => Some(token.to_owned()),
            None if address.is_loopback() => None,
            None => Some(random_token()?),
        };
        Ok(Self { token })
    }

    pub(super) fn token(&self) -> Option<&str> {
        self.token.as_deref()
    }

    /// Whether a request is to be answered; `is_page` are those that hold nothing of the scene.
    pub(super) fn check(&self, headers: &HeaderMap, is_page: bool) -> Result<(), Denied> {
        let host = text(headers, header::HOST.as_str());
        if self.token.is_none() && !host.is_some_and(is_loopback_name) {
            return Err(Denied::Host);
        }
        let is_from_elsewhere = text(headers, "sec-fetch-site") == Some("cross-site");
        if text(headers, header::ORIGIN.as_str()).is_some_and(|origin| !is_of(origin, host)) {
            return Err(Denied::Origin);
        }
        if is_page {
            return Ok(());
        }
        if is_from_elsewhere {
            return Err(Denied::Origin);
        }
        match &self.token {
            Some(token) if !text(headers, TOKEN).is_some_and(|given| is_same(token, given)) => Err(Denied::Token),
            _ => Ok(()),
        }
    }
}

fn text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

/// Names under which a machine reaches itself, with or without a port.
fn is_loopback_name(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse().is_ok_and(|address: IpAddr| address.is_loopback())
}

/// Whether an origin such as `http://localhost:7008` is of a host.
fn is_of(origin: &str, host: Option<&str>) -> bool {
    let authority = origin.parse::<Uri>().ok().and_then(|origin| origin.authority().map(ToString::to_string));
    authority.is_some() && authority.as_deref() == host
}

/// Whether two words are the same, in a time that does not tell how much of them is.
fn is_same(one: &str, other: &str) -> bool {
    let differences = one.bytes().zip(other.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    one.len() == other.len() && differences == 0
}

fn random_token() -> Result<String, Failure> {
    let mut bytes = [0; TOKEN_LEN];
    getrandom::fill(&mut bytes)
        .map_err(|error| Failure::Input(format!("the system gives no random numbers ({error}); choose a --token")))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOPBACK: IpAddr = IpAddr::V4(core::net::Ipv4Addr::LOCALHOST);
    const ANYWHERE: IpAddr = IpAddr::V4(core::net::Ipv4Addr::UNSPECIFIED);

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        pairs.iter().map(|(name, word)| (name.parse().unwrap(), word.parse().unwrap())).collect()
    }

    #[test]
    fn this_machine_is_known_by_its_own_names_alone() {
        let guard = Guard::new(LOOPBACK, None).unwrap();
        for host in ["localhost", "localhost:7008", "LOCALHOST:1", "127.0.0.1:7008", "[::1]:7008", "127.1.2.3"] {
            assert_eq!(guard.check(&headers(&[("host", host)]), false), Ok(()), "{host}");
        }
        for host in ["evil.example", "evil.example:7008", "192.168.0.2:7008", "localhost.evil.example", "[::2]", ""] {
            for is_page in [false, true] {
                assert_eq!(guard.check(&headers(&[("host", host)]), is_page), Err(Denied::Host), "{host}");
            }
        }
        assert_eq!(guard.check(&headers(&[]), true), Err(Denied::Host), "no host at all");
    }

    #[test]
    fn other_sites_may_not_ask() {
        let guard = Guard::new(LOOPBACK, None).unwrap();
        let from = |origin| headers(&[("host", "localhost:7008"), ("origin", origin)]);
        assert_eq!(guard.check(&from("http://localhost:7008"), false), Ok(()));
        for origin in ["http://evil.example", "http://localhost:80", "null"] {
            assert_eq!(guard.check(&from(origin), false), Err(Denied::Origin), "{origin}");
        }
        let linked = headers(&[("host", "localhost"), ("sec-fetch-site", "cross-site")]);
        assert_eq!((guard.check(&linked, true), guard.check(&linked, false)), (Ok(()), Err(Denied::Origin)));
    }

    #[test]
    fn from_elsewhere_a_token_is_needed() {
        let guard = Guard::new(ANYWHERE, None).unwrap();
        let token = guard.token().unwrap().to_owned();
        assert_eq!(token.len(), 2 * TOKEN_LEN);
        assert_ne!(token, Guard::new(ANYWHERE, None).unwrap().token().unwrap(), "every server has its own");
        let with = |token: &str| headers(&[("host", "192.168.0.2:7008"), (TOKEN, token)]);
        assert_eq!(guard.check(&with(&token), false), Ok(()));
        for wrong in ["", "x", &token[1..], &token.replace(|_| true, "0"), &format!("{token}0")] {
            assert_eq!(guard.check(&with(wrong), false), Err(Denied::Token), "{wrong}");
        }
        assert_eq!(guard.check(&headers(&[("host", "192.168.0.2")]), true), Ok(()), "the page holds no secret");
    }
}
