//! Addresses of links.

use std::fmt;

/// Where a link leads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Address {
    /// Datagrams to this host and port.
    UdpOut(String),
    /// Datagrams from anyone who sends them to this address.
    UdpIn(String),
    /// A connection to this host and port.
    TcpOut(String),
    /// Connections from anyone who opens them to this address.
    TcpIn(String),
    /// A serial port: its device and bits per second.
    Serial(String, u32),
}

impl Address {
    /// Reads `udpout:HOST:PORT` and the like, without looking anything up.
    ///
    /// # Errors
    /// If the text is no address; the message says what is expected.
    pub fn parse(text: &str) -> Result<Address, String> {
        let expected = || {
            format!(
                "{text:?}, expected udpout:HOST:PORT, udpin:HOST:PORT, tcpout:HOST:PORT, \
                 tcpin:HOST:PORT or serial:/dev/ttyX:BAUD"
            )
        };
        let (kind, rest) = text.split_once(':').ok_or_else(expected)?;
        let (place, number) = rest.rsplit_once(':').ok_or_else(expected)?;
        if place.is_empty() {
            return Err(expected());
        }
        if kind == "serial" {
            let baud = number.parse().map_err(|_| expected())?;
            return Ok(Address::Serial(place.into(), baud));
        }
        number.parse::<u16>().map_err(|_| expected())?;
        let socket = rest.to_string();
        match kind {
            "udpout" | "udp" => Ok(Address::UdpOut(socket)),
            "udpin" => Ok(Address::UdpIn(socket)),
            "tcpout" | "tcp" => Ok(Address::TcpOut(socket)),
            "tcpin" => Ok(Address::TcpIn(socket)),
            _ => Err(expected()),
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Address::UdpOut(socket) => write!(f, "udpout:{socket}"),
            Address::UdpIn(socket) => write!(f, "udpin:{socket}"),
            Address::TcpOut(socket) => write!(f, "tcpout:{socket}"),
            Address::TcpIn(socket) => write!(f, "tcpin:{socket}"),
            Address::Serial(device, baud) => write!(f, "serial:{device}:{baud}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn address_of_every_kind_is_read_and_written() {
        for text in [
            "udpout:10.0.0.2:14550",
            "udpin:[::]:14550",
            "tcpout:gcs.local:5760",
            "tcpin:0.0.0.0:5760",
            "serial:/dev/ttyAMA0:921600",
        ] {
            let address = Address::parse(text);

            assert_eq!(address.map(|address| address.to_string()), Ok(text.into()));
        }
    }

    #[test]
    fn wrong_address_is_refused_with_what_is_expected() {
        for text in [
            "nonsense",
            "udpbcast:10.0.0.255:14550",
            "file:/tmp/x:1",
            "serial:/dev/ttyACM0",
            "udpout:14550",
            "udpout::14550",
            "udpout:host:99999",
        ] {
            let refused = Address::parse(text).unwrap_err();

            assert!(refused.contains("expected udpout:HOST:PORT"), "{refused}");
        }
    }
}
