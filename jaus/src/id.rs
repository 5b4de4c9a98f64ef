//! Who is who: subsystem, node and component in one number.

use std::fmt;
use std::str::FromStr;

/// A JAUS address. Wildcards: subsystem 65535, node 255, component 255.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Id(u32);

impl Id {
    /// Everybody.
    pub const ALL: Self = Self(u32::MAX);

    /// An address of three parts.
    pub const fn new(subsystem: u16, node: u8, component: u8) -> Self {
        Self((subsystem as u32) << 16 | (node as u32) << 8 | component as u32)
    }

    /// From its number on the wire.
    pub const fn from_wire(wire: u32) -> Self {
        Self(wire)
    }

    /// Its number on the wire, written little-endian: component first.
    pub const fn to_wire(self) -> u32 {
        self.0
    }

    /// 1 to 65534.
    pub const fn subsystem(self) -> u16 {
        (self.0 >> 16) as u16
    }

    /// 1 to 254.
    pub const fn node(self) -> u8 {
        (self.0 >> 8) as u8
    }

    /// 1 to 254.
    pub const fn component(self) -> u8 {
        self.0 as u8
    }

    /// Whether this is one component: no part zero, no wildcard.
    pub fn is_one(self) -> bool {
        let one = |part: u8| part != 0 && part != u8::MAX;
        self.subsystem() != 0 && self.subsystem() != u16::MAX && one(self.node()) && one(self.component())
    }

    /// Whether a message to this address, wildcards understood, is for `component`.
    pub fn reaches(self, component: Self) -> bool {
        (self.subsystem() == u16::MAX || self.subsystem() == component.subsystem())
            && (self.node() == u8::MAX || self.node() == component.node())
            && (self.component() == u8::MAX || self.component() == component.component())
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.subsystem(), self.node(), self.component())
    }
}

impl fmt::Debug for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{self}")
    }
}

impl FromStr for Id {
    type Err = &'static str;

    /// From `126.1.20`.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const SHAPE: &str = "subsystem.node.component: 126.1.20";
        let mut parts = text.split('.');
        let mut next = || parts.next().ok_or(SHAPE);
        let subsystem = next()?.parse().map_err(|_| SHAPE)?;
        let node = next()?.parse().map_err(|_| SHAPE)?;
        let component = next()?.parse().map_err(|_| SHAPE)?;
        if parts.next().is_some() { Err(SHAPE) } else { Ok(Self::new(subsystem, node, component)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_written_component_first() {
        let id: Id = "126.1.20".parse().unwrap();
        // From the capture of the standard's own example: 14 01 7e 00.
        assert_eq!(id.to_wire().to_le_bytes(), [0x14, 0x01, 0x7e, 0x00]);
        assert_eq!((id.to_string(), id.is_one()), ("126.1.20".into(), true));
        for bad in ["", "1.2", "1.2.3.4", "1.2.256", "-1.2.3"] {
            assert!(bad.parse::<Id>().is_err(), "{bad}");
        }
    }

    #[test]
    fn wildcards_reach_everybody_they_name() {
        let us = Id::new(5, 1, 20);
        assert!(Id::ALL.reaches(us) && us.reaches(us) && Id::new(5, 255, 255).reaches(us));
        assert!(!Id::new(6, 255, 255).reaches(us) && !Id::new(5, 1, 21).reaches(us));
        assert!(!Id::ALL.is_one() && !Id::new(5, 0, 1).is_one());
    }
}
