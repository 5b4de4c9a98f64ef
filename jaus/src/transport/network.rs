//! Whom we listen to: single addresses and whole networks.

use std::fmt;
use std::net::IpAddr;
use std::str::FromStr;

/// Addresses that share a prefix.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network {
    address: IpAddr,
    prefix_bits: u8,
}

impl Network {
    /// Whether an address is in it.
    pub fn contains(&self, address: IpAddr) -> bool {
        let same = |ours: u128, theirs: u128, bits: u32| {
            let free = bits - u32::from(self.prefix_bits);
            // A shift by all bits is none at all.
            free >= bits || ours >> free == theirs >> free
        };
        match (self.address, address) {
            (IpAddr::V4(ours), IpAddr::V4(theirs)) => same(ours.to_bits().into(), theirs.to_bits().into(), 32),
            (IpAddr::V6(ours), IpAddr::V6(theirs)) => same(ours.to_bits(), theirs.to_bits(), 128),
            _ => false,
        }
    }
}

impl FromStr for Network {
    type Err = &'static str;

    /// From `192.168.1.7` or `192.168.1.0/24`.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const SHAPE: &str = "an address or a network: 192.168.1.7, 192.168.1.0/24";
        let (address, prefix) = text.split_once('/').map_or((text, None), |(a, p)| (a, Some(p)));
        let address: IpAddr = address.parse().map_err(|_| SHAPE)?;
        let bits = if address.is_ipv4() { 32 } else { 128 };
        let prefix_bits = prefix.map_or(Ok(bits), |p| p.parse().map_err(|_| SHAPE))?;
        if prefix_bits > bits { Err(SHAPE) } else { Ok(Self { address, prefix_bits }) }
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.address, self.prefix_bits)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_contains_its_addresses_and_no_other() {
        let check =
            |network: &str, address: &str| network.parse::<Network>().unwrap().contains(address.parse().unwrap());
        assert!(check("192.168.1.0/24", "192.168.1.250") && !check("192.168.1.0/24", "192.168.2.1"));
        assert!(check("10.0.0.7", "10.0.0.7") && !check("10.0.0.7", "10.0.0.6"));
        assert!(check("0.0.0.0/0", "8.8.8.8") && !check("0.0.0.0/0", "::1"));
        assert!(check("fe80::/10", "fe80::1") && check("::/0", "::1"));
        for bad in ["", "10.0.0.0/33", "10.0.0", "10.0.0.1/x", "::/129"] {
            assert!(bad.parse::<Network>().is_err(), "{bad}");
        }
    }
}
