//! Places of one UTM zone in another zone, and in degrees.
//!
//! In and out: easting and northing in metres on WGS 84; longitude and latitude in degrees. Heights do not change.
//! Source: the `proj4rs` port of PROJ.

use crate::zone::Zone;
use proj4rs::Proj;
use proj4rs::transform::transform;

/// From one zone to another.
pub struct Reprojection {
    from: Proj,
    to: Proj,
    to_degrees: bool,
}

impl Reprojection {
    /// Between two zones; nothing where the projection library refuses.
    pub fn between(from: Zone, to: Zone) -> Option<Self> {
        Some(Self { from: utm(from)?, to: utm(to)?, to_degrees: false })
    }

    /// From a zone to longitude and latitude, degrees.
    pub fn to_degrees(from: Zone) -> Option<Self> {
        let to = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
        Some(Self { from: utm(from)?, to, to_degrees: true })
    }

    /// A place; nothing where it lies too far from the other zone to be projected.
    pub fn apply(&self, [east_m, north_m]: [f64; 2]) -> Option<[f64; 2]> {
        let mut point = (east_m, north_m, 0.0);
        transform(&self.from, &self.to, &mut point).ok()?;
        let place = if self.to_degrees { [point.0.to_degrees(), point.1.to_degrees()] } else { [point.0, point.1] };
        place.iter().all(|x| x.is_finite()).then_some(place)
    }
}

fn utm(zone: Zone) -> Option<Proj> {
    let (number, south) = zone.to_wire();
    let south = if south == 1 { " +south" } else { "" };
    Proj::from_proj_string(&format!("+proj=utm +zone={number}{south} +datum=WGS84 +units=m +no_defs")).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zone(epsg: i32) -> Zone {
        Zone::from_epsg(epsg).unwrap()
    }

    /// The border of zones 17 and 18 is 78 degrees west: the same place has mirrored eastings, 500 km +- d.
    #[test]
    fn a_place_on_the_border_mirrors_and_comes_back() {
        let degrees = Reprojection::to_degrees(zone(32_617)).unwrap();
        let there = Reprojection::between(zone(32_617), zone(32_618)).unwrap();
        let back = Reprojection::between(zone(32_618), zone(32_617)).unwrap();
        // On the equator three degrees from the central meridian: 833 978.557 m, as tables of UTM say.
        let border = [833_978.557, 0.0];
        let [longitude, latitude] = degrees.apply(border).unwrap();
        assert!((longitude + 78.0).abs() < 1e-8 && latitude.abs() < 1e-9, "{longitude} {latitude}");
        let [east, north] = there.apply(border).unwrap();
        assert!((east - (1e6 - 833_978.557)).abs() < 1e-3 && north.abs() < 1e-6, "{east} {north}");
        for place in [[500_000.0, 4_000_000.0], [700_000.0, 5_500_000.0]] {
            let [east, north] = back.apply(there.apply(place).unwrap()).unwrap();
            assert!((east - place[0]).hypot(north - place[1]) < 1e-5, "{east} {north}");
        }
    }

    #[test]
    fn the_southern_hemisphere_starts_from_ten_million() {
        let there = Reprojection::between(zone(32_617), zone(32_717)).unwrap();
        assert!((there.apply([500_000.0, 100.0]).unwrap()[1] - 10_000_100.0).abs() < 1e-6);
        let degrees = Reprojection::to_degrees(zone(32_756)).unwrap();
        let [longitude, latitude] = degrees.apply([500_000.0, 10_000_000.0]).unwrap();
        assert!((longitude - 153.0).abs() < 1e-9 && latitude.abs() < 1e-9);
    }
}
