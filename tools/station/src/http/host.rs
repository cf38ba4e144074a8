//! The host names of this server.
//!
//! A page of another site can have its own name looked up as this machine's address and then read
//! everything here (DNS rebinding). Its requests name the other site as `Host`, and are refused.

use std::net::IpAddr;

/// The names that a request may be addressed to, besides addresses.
#[derive(Debug)]
pub struct Hosts(Vec<String>);

impl Hosts {
    /// The names of a server that listens at `address`.
    pub fn new(address: &str, names: &[String]) -> Hosts {
        let mut known = vec!["localhost".to_string()];
        known.push(without_port(address).to_ascii_lowercase());
        known.extend(names.iter().map(|name| name.to_ascii_lowercase()));
        // The machine's own name, as routers and multicast DNS know it.
        if let Ok(name) = std::fs::read_to_string("/proc/sys/kernel/hostname") {
            let name = name.trim().to_ascii_lowercase();
            known.push(format!("{name}.local"));
            known.push(name);
        }
        Hosts(known)
    }

    /// Whether a request with this `Host` is for this server; browsers always send one.
    pub fn know(&self, host: Option<&[u8]>) -> bool {
        let Some(host) = host else {
            return true;
        };
        let Ok(host) = std::str::from_utf8(host) else {
            return false;
        };
        let name = without_port(host.trim());
        // An address cannot be rebound to another one.
        let is_address = name.parse::<IpAddr>().is_ok();
        is_address || self.0.iter().any(|known| known.eq_ignore_ascii_case(name))
    }
}

/// The host without its port, and without the brackets of an IPv6 address.
fn without_port(host: &str) -> &str {
    if let Some(rest) = host.strip_prefix('[') {
        return rest.split(']').next().unwrap_or_default();
    }
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_and_own_names_are_known_and_other_sites_are_not() {
        let hosts = Hosts::new("drone:8080", &["Camera.example".into()]);
        for (host, expected) in [
            ("127.0.0.1:8080", true),
            ("192.168.1.7", true),
            ("[::1]:8080", true),
            ("localhost:8080", true),
            ("LOCALHOST", true),
            ("drone:8080", true),
            ("camera.example:8080", true),
            ("evil.example", false),
            ("evil.example:8080", false),
            ("127.0.0.1.evil.example", false),
            ("", false),
        ] {
            assert_eq!(hosts.know(Some(host.as_bytes())), expected, "{host}");
        }
        assert!(hosts.know(None), "a program that sends no Host");
    }
}
