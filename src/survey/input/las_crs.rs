//! The coordinate system that a LAS file carries: its EPSG codes, or else whether it is in metres at all.
//!
//! In: the GeoTIFF keys or the WKT (1 or 2) of a header. Out: a [`System`]. It knows no register: whether a code is one of
//! a projected system is for the caller to find out. Source: OGC 19-008r4 (GeoTIFF keys), OGC 18-010r11 (WKT).

use super::{Codes, System};
use las::crs::{GeoTiffCrs, GeoTiffData};

/// Words that begin a system of easting and northing, or of longitude and latitude.
const PLANES: [&str; 8] =
    ["PROJCRS[", "PROJECTEDCRS[", "PROJCS[", "GEOGCRS[", "GEODCRS[", "GEOGRAPHICCRS[", "GEODETICCRS[", "GEOGCS["];
/// Words that begin a system of heights.
const HEIGHTS: [&str; 4] = ["VERTCRS[", "VERTICALCRS[", "VERT_CS[", "VERTCS["];
/// GeoTIFF key: kind of the coordinates; 2 is longitude and latitude.
const MODEL: u16 = 1024;
/// GeoTIFF key: code of the projected system.
const PROJECTED: u16 = 3072;
/// GeoTIFF key: unit of easting and northing.
const UNIT: u16 = 3076;
/// GeoTIFF key: code of the system of heights.
const VERTICAL: u16 = 4096;
/// GeoTIFF key: unit of heights.
const VERTICAL_UNIT: u16 = 4099;
/// EPSG code of the metre.
const METRE: u16 = 9001;

/// What a header says of its coordinates.
pub fn system_of(header: &las::Header) -> System {
    let keys = header.get_geotiff_crs().ok().flatten();
    let wkt = header.get_wkt_crs_bytes().map(String::from_utf8_lossy);
    match (keys.as_ref().map(of_keys), wkt) {
        (Some(System::Codes(codes)), _) => System::Codes(codes),
        (_, Some(wkt)) => of_wkt(&wkt),
        (system, None) => system.unwrap_or(System::Unknown),
    }
}

fn of_keys(keys: &GeoTiffCrs) -> System {
    let value = |id| keys.entries.iter().find(|entry| entry.id == id).map(|entry| &entry.data);
    let number = |id| if let Some(GeoTiffData::U16(number)) = value(id) { Some(*number) } else { None };
    // Others than these are the user's own.
    let code = |id| number(id).filter(|code| (1024..=32_766).contains(code));
    let is_foreign = |own, unit| code(own).is_none() && number(unit).is_some_and(|unit| unit != METRE);
    match code(PROJECTED) {
        _ if number(MODEL) == Some(2) => System::NotMetres("degrees".into()),
        _ if is_foreign(PROJECTED, UNIT) || is_foreign(VERTICAL, VERTICAL_UNIT) => {
            System::NotMetres("another unit than the metre".into())
        }
        Some(horizontal) => System::Codes(Codes { horizontal, vertical: code(VERTICAL) }),
        None => System::Unknown,
    }
}

fn of_wkt(wkt: &str) -> System {
    let first = |words: &[&str], text: &str| words.iter().filter_map(|word| text.find(word)).min();
    let (plane, heights) = wkt.split_at(first(&HEIGHTS, wkt).unwrap_or(wkt.len()));
    let plane = element(&plane[first(&PLANES, plane).unwrap_or(plane.len())..]);
    let heights = element(heights);
    match ([plane, heights].iter().find_map(|part| foreign_unit(part)), plane.code) {
        (Some(unit), _) => System::NotMetres(unit),
        (None, Some(horizontal)) => System::Codes(Codes { horizontal, vertical: heights.code }),
        (None, None) => System::Unknown,
    }
}

/// A part of a WKT up to its closing bracket.
#[derive(Clone, Copy)]
struct Element<'a> {
    text: &'a str,
    /// The EPSG code of the part itself, not of what it is made of.
    code: Option<u16>,
}

/// The part that a text begins with.
fn element(text: &str) -> Element<'_> {
    let (mut depth, mut is_quoted, mut code) = (0, false, None);
    for (at, c) in text.char_indices() {
        match c {
            '"' => is_quoted = !is_quoted,
            '[' if !is_quoted => {
                depth += 1;
                if depth == 2 && ["ID", "AUTHORITY"].iter().any(|word| text[..at].ends_with(word)) {
                    code = epsg(&text[at + 1..]).or(code);
                }
            }
            ']' if !is_quoted => depth -= 1,
            _ => {}
        }
        if c == ']' && depth == 0 {
            return Element { text: &text[..at], code };
        }
    }
    Element { text, code }
}

/// The number in `"EPSG",n]` or `"EPSG","n"]`.
fn epsg(text: &str) -> Option<u16> {
    let number = text.strip_prefix("\"EPSG\",")?;
    number[..number.find([']', ','])?].trim().trim_matches('"').parse().ok()
}

/// The name of a part's unit, where that is no metre and no code tells more: the last unit is that of the coordinates.
fn foreign_unit(part: &Element) -> Option<String> {
    let tail = &part.text[part.text.rfind("UNIT[\"")? + 6..];
    let (name, factor) = tail.split_once("\",")?;
    let factor: f64 = factor[..factor.find([']', ',']).unwrap_or(factor.len())].trim().parse().ok()?;
    (part.code.is_none() && (factor - 1.0).abs() > 1e-9).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(horizontal: u16, vertical: Option<u16>) -> System {
        System::Codes(Codes { horizontal, vertical })
    }

    #[test]
    fn the_code_of_a_system_is_its_own_and_not_one_of_its_parts() {
        let plain = r#"PROJCS["x",GEOGCS["y",AUTHORITY["EPSG","4326"]],UNIT["metre",1],AUTHORITY["EPSG","32612"]]"#;
        assert_eq!(of_wkt(plain), codes(32612, None));
        let compound = r#"COMPOUNDCRS["x",PROJCRS["y [z]",ID["EPSG",32617]],VERTCRS["z",ID["EPSG",5773]]]"#;
        assert_eq!(of_wkt(compound), codes(32617, Some(5773)));
        let with_a_code = r#"COMPD_CS["x",PROJCS["y",AUTHORITY["EPSG","6341"]],VERT_CS["z",UNIT["metre",1,
            AUTHORITY["EPSG","9001"]],AUTHORITY["EPSG","5703"]],AUTHORITY["EPSG","6350"]]"#;
        assert_eq!(of_wkt(with_a_code), codes(6341, Some(5703)));
        let own = r#"PROJCS["mine",GEOGCS["y",AUTHORITY["EPSG","4326"]],UNIT["metre",1,AUTHORITY["EPSG","9001"]]]"#;
        assert_eq!(of_wkt(own), System::Unknown);
        assert_eq!([of_wkt(r#"LOCAL_CS["x"]"#), of_wkt(""), of_wkt("PROJCS[[[")], [const { System::Unknown }; 3]);
    }

    #[test]
    fn feet_and_degrees_are_told_where_no_code_is() {
        let feet = r#"PROJCS["x",GEOGCS["y",UNIT["Degree",0.0174]],UNIT["Foot_US",0.304800609601219]]"#;
        assert_eq!(of_wkt(feet), System::NotMetres("Foot_US".into()));
        let degrees = r#"GEOGCS["GCS_WGS_1984",DATUM["d"],UNIT["Degree",0.0174532925199433]]"#;
        assert_eq!(of_wkt(degrees), System::NotMetres("Degree".into()));
        let heights =
            format!(r#"{},VERTCS["NAVD_1988",UNIT["Foot_US",0.3048006]]"#, feet.replace("0.304800609601219", "1"));
        assert_eq!(of_wkt(&heights), System::NotMetres("Foot_US".into()));
    }

    #[test]
    fn keys_of_the_users_own_are_no_codes() {
        let keys = |list: &[(u16, u16)]| {
            let entry =
                |(id, value): &(u16, u16)| las::crs::GeoTiffKeyEntry { id: *id, data: GeoTiffData::U16(*value) };
            of_keys(&GeoTiffCrs { entries: list.iter().map(entry).collect() })
        };
        assert_eq!(keys(&[(MODEL, 1), (PROJECTED, 32617), (VERTICAL, 5703)]), codes(32617, Some(5703)));
        assert_eq!(keys(&[(MODEL, 1), (PROJECTED, 32_767), (UNIT, METRE)]), System::Unknown);
        assert!(matches!(keys(&[(MODEL, 1), (PROJECTED, 32_767), (UNIT, 9003)]), System::NotMetres(_)));
        assert!(matches!(keys(&[(MODEL, 1), (PROJECTED, 32617), (VERTICAL_UNIT, 9002)]), System::NotMetres(_)));
        assert_eq!(keys(&[(MODEL, 2)]), System::NotMetres("degrees".into()));
    }
}
