//! Coordinate reference systems: a projected one, with a vertical one beside it where the heights' datum is known.
//!
//! In: what a user writes (`EPSG:32617`, `EPSG:32617+5773`). Out: codes and their definition as text (WKT 2). Codes that
//! are not in the EPSG register, not projected, or not in metres are refused: a survey measures in metres. It transforms
//! nothing. Source: the EPSG dataset in `epsg-utils`.

use super::input::System;
use std::str::FromStr;

/// A coordinate reference system by its EPSG codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crs {
    /// Projected, metres.
    pub horizontal: u16,
    /// Of the heights, metres; nothing where the datum was not said.
    pub vertical: Option<u16>,
}

impl Crs {
    /// A projected system, heights of an unknown datum.
    pub fn projected(code: u16) -> Result<Self, String> {
        let wkt = definition(code)?;
        if !wkt.starts_with("PROJCRS[") {
            let name = name_of(wkt);
            return Err(format!("EPSG:{code} ({name}) is not projected; coordinates must be metres, as UTM's are"));
        }
        if !is_metric(wkt) {
            return Err(format!("EPSG:{code} ({}) is not in metres; reproject the input", name_of(wkt)));
        }
        Ok(Self { horizontal: code, vertical: None })
    }

    /// The same with the datum of the heights.
    pub fn with_heights(self, code: u16) -> Result<Self, String> {
        let wkt = definition(code)?;
        if !wkt.starts_with("VERTCRS[") || !is_metric(wkt) || !wkt.contains(",up") {
            return Err(format!("EPSG:{code} ({}) is no height in metres; EPSG:5773 is (EGM96)", name_of(wkt)));
        }
        Ok(Self { vertical: Some(code), ..self })
    }

    /// What a file says of itself, if anything. A code of heights that names none is left out: their datum is not known.
    pub fn of_file(system: &System) -> Result<Option<Self>, String> {
        let codes = match system {
            System::Unknown => return Ok(None),
            System::NotMetres(unit) => return Err(format!("its coordinates are not in metres ({unit})")),
            System::Codes(codes) => codes,
        };
        let plane = Self::projected(codes.horizontal)?;
        let is_height = |code: &u16| definition(*code).is_ok_and(|wkt| wkt.starts_with("VERTCRS["));
        codes.vertical.filter(is_height).map_or(Ok(plane), |code| plane.with_heights(code)).map(Some)
    }

    /// What a file says of itself, where it is something else.
    pub fn overrules(&self, system: &System) -> Option<String> {
        match system {
            System::Codes(codes) if codes.horizontal != self.horizontal => Some(format!("EPSG:{}", codes.horizontal)),
            System::NotMetres(unit) => Some(unit.clone()),
            _ => None,
        }
    }

    /// Its definition as WKT 2, compound where the heights' datum is known.
    pub fn wkt(&self) -> String {
        let plane = definition(self.horizontal).unwrap_or_default();
        match self.vertical.and_then(|code| definition(code).ok()) {
            Some(heights) => format!("COMPOUNDCRS[\"{}\",{plane},{heights}]", self.name()),
            None => plane.to_owned(),
        }
    }

    /// Its name in words.
    pub fn name(&self) -> String {
        let name = |code| definition(code).map(name_of).unwrap_or_default().to_owned();
        match self.vertical {
            Some(heights) => format!("{} + {}", name(self.horizontal), name(heights)),
            None => name(self.horizontal),
        }
    }
}

impl std::fmt::Display for Crs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "EPSG:{}", self.horizontal)?;
        self.vertical.map_or(Ok(()), |code| write!(f, "+{code}"))
    }
}

impl FromStr for Crs {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let codes = text.strip_prefix("EPSG:").or_else(|| text.strip_prefix("epsg:")).unwrap_or(text);
        let code =
            |word: &str| word.trim().parse::<u16>().map_err(|_| "write EPSG:32617, or EPSG:32617+5773".to_owned());
        match codes.split_once('+') {
            Some((plane, heights)) => Self::projected(code(plane)?)?.with_heights(code(heights)?),
            None => Self::projected(code(codes)?),
        }
    }
}

fn definition(code: u16) -> Result<&'static str, String> {
    epsg_utils::epsg_to_wkt2(code.into()).map_err(|_| format!("EPSG:{code} is not in the EPSG register"))
}

/// The first quoted words of a definition.
fn name_of(wkt: &str) -> &str {
    wkt.split('"').nth(1).unwrap_or_default()
}

/// Whether the axes of a definition are in metres; the units of its parameters come before its axes.
fn is_metric(wkt: &str) -> bool {
    let axes = &wkt[wkt.rfind("CS[").unwrap_or(0)..];
    axes.contains("LENGTHUNIT[\"metre\",1")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::input::Codes;

    #[test]
    fn codes_read_as_people_write_them_and_foreign_ones_are_refused() {
        let plain: Crs = "EPSG:32617".parse().unwrap();
        assert_eq!((plain.horizontal, plain.vertical), (32617, None));
        let compound: Crs = "EPSG:32617+5773".parse().unwrap();
        assert_eq!((compound.to_string().as_str(), compound.vertical), ("EPSG:32617+5773", Some(5773)));
        assert!(compound.wkt().starts_with("COMPOUNDCRS[\"WGS 84 / UTM zone 17N + EGM96 height\",PROJCRS["));
        for (wrong, why) in [
            ("EPSG:x", "write"),
            ("EPSG:4326", "not projected"),
            ("EPSG:2225", "not in metres"),
            ("EPSG:60000", "register"),
            ("EPSG:32617+32618", "no height"),
        ] {
            let said = wrong.parse::<Crs>().unwrap_err();
            assert!(said.contains(why), "{wrong}: {said}");
        }
    }

    #[test]
    fn the_heights_of_a_file_are_kept_where_they_are_heights_in_metres() {
        let file = |vertical| Crs::of_file(&System::Codes(Codes { horizontal: 6341, vertical: Some(vertical) }));
        let heights = |vertical| file(vertical).map(|crs| crs.unwrap().vertical);
        assert_eq!(heights(5703), Ok(Some(5703)));
        // Ellipsoidal heights, and a unit: no system of heights.
        assert_eq!([heights(4979), heights(9001)], [Ok(None), Ok(None)]);
        assert!(file(6360).unwrap_err().contains("NAVD88 height (ftUS)"), "feet are not read as metres");
        assert_eq!(Crs::of_file(&System::Unknown), Ok(None));
        assert!(Crs::of_file(&System::NotMetres("Degree".into())).unwrap_err().contains("Degree"));
    }

    #[test]
    fn what_the_command_says_overrules_the_file_and_that_is_told() {
        let crs: Crs = "EPSG:32617+5773".parse().unwrap();
        let file = |horizontal| System::Codes(Codes { horizontal, vertical: None });
        assert_eq!([crs.overrules(&file(32617)), crs.overrules(&System::Unknown)], [None, None]);
        assert_eq!(crs.overrules(&file(32618)).as_deref(), Some("EPSG:32618"));
    }
}
