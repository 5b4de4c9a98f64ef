//! Words on the command line with a unit (`60s`, `5m`, `2x`) or bounds.

use tsense_ports::{Domain, PortError};

/// A length of time: `90`, `90s`, `1.5m`, `2h`. Seconds.
pub fn seconds(text: &str) -> Result<f64, String> {
    let (number, factor) = match text.trim_end_matches(|c: char| c.is_ascii_alphabetic()) {
        number if number.len() == text.len() => (number, 1.0),
        number => match &text[number.len()..] {
            "s" => (number, 1.0),
            "m" | "min" => (number, 60.0),
            "h" => (number, 3600.0),
            other => return Err(format!("unit '{other}' is none of s, m, h")),
        },
    };
    let value: f64 = number.parse().map_err(|_| format!("'{text}' is no time; write for example 60s or 5m"))?;
    let seconds = value * factor;
    if (0.1..=31.0 * 86_400.0).contains(&seconds) { Ok(seconds) } else { Err("from 0.1s to 31 days".into()) }
}

/// A speed of the world against real time: `1x`, `2.5x`, `4`.
pub fn speed(text: &str) -> Result<f64, String> {
    let value: f64 =
        text.strip_suffix('x').unwrap_or(text).parse().map_err(|_| format!("'{text}' is no speed; write 1x or 2x"))?;
    if (0.1..=20.0).contains(&value) { Ok(value) } else { Err("from 0.1x to 20x".into()) }
}

/// The name of a graph.
pub fn graph(text: &str) -> Result<String, String> {
    match Domain::new(text) {
        Ok(domain) => Ok(domain.name().to_owned()),
        Err(PortError::BadName { problem, .. }) => Err(problem),
        Err(other) => Err(other.to_string()),
    }
}

/// A number from `low` to `high`; NaN is none.
pub fn within(low: f64, high: f64) -> impl Fn(&str) -> Result<f64, String> + Clone {
    move |text| {
        let value = text.trim().parse().ok().filter(|value| (low..=high).contains(value));
        value.ok_or_else(|| format!("give a number from {low} to {high}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_speeds_read_as_people_write_them() {
        assert_eq!(seconds("60s"), Ok(60.0));
        assert_eq!(seconds("1.5m"), Ok(90.0));
        assert_eq!(seconds("7"), Ok(7.0));
        assert!(seconds("5 parsecs").is_err() && seconds("0s").is_err() && seconds("NaN").is_err());
        assert_eq!(speed("2.5x"), Ok(2.5));
        assert!(speed("fast").is_err() && speed("99x").is_err());
    }

    #[test]
    fn a_number_lies_within_its_bounds() {
        let metres = within(0.01, 10.0);
        assert_eq!((metres("0.15"), metres("10")), (Ok(0.15), Ok(10.0)));
        for refused in ["nan", "inf", "0", "-1", "1e300", "0,15", ""] {
            assert_eq!(metres(refused), Err("give a number from 0.01 to 10".into()), "{refused}");
        }
    }
}
