//! Addresses of a page on stdout, and a code for phones on a terminal.

use crate::{failure::Failure, output};
use core::net::{IpAddr, SocketAddr};
use qrcode::{EcLevel, QrCode, render::unicode::Dense1x2};
use std::io::IsTerminal;

/// Says the addresses of a page that is served at this one.
pub(super) fn announce(served_at: SocketAddr, token: Option<&str>) -> Result<(), Failure> {
    let own = if_addrs::get_if_addrs().unwrap_or_default().into_iter().map(|interface| interface.ip());
    let fragment = token.map_or(String::new(), |token| format!("#token={token}"));
    let addresses: Vec<String> =
        reached_at(served_at, own).iter().map(|address| format!("http://{address}/{fragment}")).collect();
    addresses.iter().try_for_each(|address| output::say(address))?;
    if !served_at.ip().is_loopback() && std::io::stderr().is_terminal() {
        let code = addresses.first().and_then(|address| code_of(address));
        code.iter().for_each(|code| tracing::info!("for a phone:\n{code}"));
    }
    Ok(())
}

/// The addresses under which others reach a server: those of this machine, where it is served at all of them.
fn reached_at(served_at: SocketAddr, own: impl Iterator<Item = IpAddr>) -> Vec<SocketAddr> {
    let is_served = |ip: &IpAddr| served_at.is_ipv6() || ip.is_ipv4();
    let is_reached = |ip: &IpAddr| match ip {
        IpAddr::V4(ip) => !ip.is_loopback() && !ip.is_link_local(),
        IpAddr::V6(ip) => !ip.is_loopback() && !ip.is_unicast_link_local(),
    };
    let own = own.filter(|ip| served_at.ip().is_unspecified() && is_served(ip) && is_reached(ip));
    let mut reached: Vec<SocketAddr> = own.map(|ip| SocketAddr::new(ip, served_at.port())).collect();
    // Those of IPv4, which are shorter, first.
    reached.sort();
    if reached.is_empty() { vec![served_at] } else { reached }
}

/// An address as a code that cameras read.
fn code_of(address: &str) -> Option<String> {
    let code = QrCode::with_error_correction_level(address, EcLevel::L).ok()?;
    Some(code.render::<Dense1x2>().dark_color(Dense1x2::Light).light_color(Dense1x2::Dark).build())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_addresses_of_a_machine_are_named_where_all_are_served() {
        let own =
            || ["127.0.0.1", "::1", "fe80::1", "2001:db8::7", "192.168.0.7"].into_iter().map(|ip| ip.parse().unwrap());
        let told = |served: &str| {
            let reached = reached_at(served.parse().unwrap(), own());
            reached.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(told("0.0.0.0:7008"), ["192.168.0.7:7008"]);
        assert_eq!(told("[::]:7008"), ["192.168.0.7:7008", "[2001:db8::7]:7008"]);
        assert_eq!(told("127.0.0.1:80"), ["127.0.0.1:80"]);
        assert_eq!(told("10.0.0.1:80"), ["10.0.0.1:80"]);
        let served = SocketAddr::from(([0; 8], 1));
        assert_eq!(reached_at(served, [].into_iter()), [served], "nothing better is known");
    }

    #[test]
    fn a_code_holds_an_address_with_its_token() {
        let code = code_of("http://192.168.100.200:65535/#token=0123456789abcdef0123456789abcdef").unwrap();
        assert!(code.lines().count() < 24 && code.contains('█'), "{code}");
    }
}
