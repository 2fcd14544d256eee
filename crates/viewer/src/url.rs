//! URLs of a server, and their QR code.

use core::net::{IpAddr, SocketAddr};
use qrcode::{EcLevel, QrCode, render::unicode::Dense1x2};

/// URLs of a server that listens at an address, with the token in their fragment.
pub(crate) fn urls(listening: SocketAddr, token: Option<&str>) -> Vec<String> {
    let interfaces = if_addrs::get_if_addrs().unwrap_or_default().into_iter().map(|interface| interface.ip());
    let fragment = token.map_or(String::new(), |token| format!("#token={token}"));
    let reachable = reachable_addresses(listening, interfaces);
    reachable.iter().map(|address| format!("http://{address}/{fragment}")).collect()
}

/// Addresses at which other machines reach a server: those of its network interfaces if it listens
/// at the unspecified address.
fn reachable_addresses(listening: SocketAddr, interfaces: impl Iterator<Item = IpAddr>) -> Vec<SocketAddr> {
    let is_served = |ip: &IpAddr| listening.is_ipv6() || ip.is_ipv4();
    let is_reachable = |ip: &IpAddr| match ip {
        IpAddr::V4(ip) => !ip.is_loopback() && !ip.is_link_local(),
        IpAddr::V6(ip) => !ip.is_loopback() && !ip.is_unicast_link_local(),
    };
    let listens_everywhere = listening.ip().is_unspecified();
    let interfaces = interfaces.filter(|ip| listens_everywhere && is_served(ip) && is_reachable(ip));
    let mut reachable: Vec<SocketAddr> = interfaces.map(|ip| SocketAddr::new(ip, listening.port())).collect();
    // IPv4 first, because its addresses are shorter.
    reachable.sort();
    if reachable.is_empty() { vec![listening] } else { reachable }
}

/// QR code of a URL in Unicode half blocks, dark on light.
pub(crate) fn qr_code(url: &str) -> Option<String> {
    let code = QrCode::with_error_correction_level(url, EcLevel::L).ok()?;
    Some(code.render::<Dense1x2>().dark_color(Dense1x2::Light).light_color(Dense1x2::Dark).build())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_served_addresses_of_a_machine_are_named() {
        let interfaces =
            || ["127.0.0.1", "::1", "fe80::1", "2001:db8::7", "192.168.0.7"].into_iter().map(|ip| ip.parse().unwrap());
        let reachable = |listening: &str| {
            let addresses = reachable_addresses(listening.parse().unwrap(), interfaces());
            addresses.iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(reachable("0.0.0.0:7008"), ["192.168.0.7:7008"]);
        assert_eq!(reachable("[::]:7008"), ["192.168.0.7:7008", "[2001:db8::7]:7008"]);
        assert_eq!(reachable("127.0.0.1:80"), ["127.0.0.1:80"]);
        assert_eq!(reachable("10.0.0.1:80"), ["10.0.0.1:80"]);
        let listening = SocketAddr::from(([0; 8], 1));
        assert_eq!(reachable_addresses(listening, [].into_iter()), [listening], "nothing better is known");
    }

    #[test]
    fn a_code_contains_the_address_with_its_token() {
        let code = qr_code("http://192.168.100.200:65535/#token=0123456789abcdef0123456789abcdef").unwrap();
        assert!(code.lines().count() < 24 && code.contains('█'), "{code}");
    }
}
