//! The UTM zone all positions of a store share.

/// A UTM zone and hemisphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Zone {
    /// 1 to 60.
    number: u8,
    /// South of the equator.
    south: bool,
}

impl Zone {
    /// From a message's two bytes; nothing before the first valid pose (zone 0) or where the bytes make no sense.
    pub fn from_wire(zone: u8, south: u8) -> Option<Self> {
        ((1..=60).contains(&zone) && south <= 1).then_some(Self { number: zone, south: south == 1 })
    }
    /// As a message's two bytes: zone, south.
    pub fn to_wire(self) -> (u8, u8) {
        (self.number, u8::from(self.south))
    }
    /// Its code in the EPSG register: WGS 84 / UTM zone, 326xx north and 327xx south.
    pub fn epsg(self) -> i32 {
        (if self.south { 32_700 } else { 32_600 }) + i32::from(self.number)
    }
    /// The zone of an EPSG code, if it is a UTM zone on WGS 84.
    pub fn from_epsg(code: i32) -> Option<Self> {
        let south = code > 32_700;
        let number = u8::try_from(code - if south { 32_700 } else { 32_600 }).ok()?;
        Self::from_wire(number, u8::from(south))
    }
}

impl std::fmt::Display for Zone {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}{}", self.number, if self.south { 'S' } else { 'N' })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_and_epsg_codes_agree_both_ways() {
        assert_eq!(Zone::from_wire(17, 0).unwrap().epsg(), 32617);
        assert_eq!(Zone::from_wire(56, 1).unwrap().epsg(), 32756);
        for number in 1..=60 {
            for south in 0..=1 {
                let zone = Zone::from_wire(number, south).unwrap();
                assert_eq!(Zone::from_epsg(zone.epsg()), Some(zone));
            }
        }
        assert_eq!([Zone::from_wire(0, 0), Zone::from_wire(61, 0), Zone::from_wire(1, 2)], [None; 3]);
        assert_eq!([4326, 32600, 32661, 32700, 32761].map(Zone::from_epsg), [None; 5]);
    }
}
