//! An object as one vehicle reports it, checked at the edge.
//!
//! In: items of a page off the link. Out: what the vehicle knows of it with nothing left to check, or why not. Places
//! stay in the zone they came in; the caller projects them.

use crate::config::Config;
use crate::object::{
    Estimate, GROUND_MAX_M, HEIGHT_MAX_M, Known, POSITION_STD_MAX_M, REACH_MAX_M, Refusal, TRUNK_MAX_M, measured,
};
use tsense_contract::{Class, FleetObject};
use tsense_geometry::{COORDINATE_MAX_M, Timestamp};

/// SQLite's integers are signed.
const ID_MAX: u64 = i64::MAX as u64;

/// What a vehicle says of an object, `now` being the instant at the station.
pub fn parse(item: &FleetObject, now: Timestamp, config: &Config) -> Result<Known, Refusal> {
    let o = &item.object;
    let (std, confidence) = (f64::from(o.position_std_m), f64::from(o.confidence));
    let place_m = [o.easting_m, o.northing_m];
    let class = Class::from_wire(o.class);
    let refusals = [
        (!place_m.iter().chain(&[o.ground_m, std, confidence]).all(|x| x.is_finite()), Refusal::NotFinite),
        (place_m.iter().any(|x| x.abs() > COORDINATE_MAX_M) || o.ground_m.abs() > GROUND_MAX_M, Refusal::OffMap),
        (!(0.0..=POSITION_STD_MAX_M).contains(&std) || confidence <= 0.0 || o.sightings == 0, Refusal::Unsure),
        (class == Class::Unknown || !(1..=ID_MAX).contains(&o.id), Refusal::UnknownClass),
    ];
    if let Some((_, refusal)) = refusals.into_iter().find(|(applies, _)| *applies) {
        return Err(refusal);
    }
    let dbh = measured(o.dbh_m, if class == Class::Tree { TRUNK_MAX_M } else { REACH_MAX_M })?;
    let height_m = measured(o.height_m, HEIGHT_MAX_M)?;
    let mut known = Known {
        id: o.id,
        class,
        first_seen: Timestamp::from_ns(o.first_seen_ns.min(o.last_seen_ns)),
        last_seen: Timestamp::from_ns(o.last_seen_ns),
        weighed: Timestamp::from_ns(item.weighed_ns),
        confidence: confidence.min(config.confidence_max),
        sightings: o.sightings,
        independent: 0,
        independent_at: Timestamp::default(),
        place_m,
        ground_m: o.ground_m,
        position_std_m: std.max(config.position_std_floor_m),
        dbh: dbh.map(|value| Estimate { value, std: dbh_std_m(o.dbh_std_m, config) }),
        height_m,
        companions: Vec::new(),
        reported: true,
        noted_m: place_m,
    };
    // A vehicle whose clock runs ahead must not keep an object from fading here.
    known.not_after(now);
    establish(&mut known, config);
    Ok(known)
}

/// A vehicle reports only what it has seen often and long enough.
pub fn establish(known: &mut Known, config: &Config) {
    known.independent = config.sightings_of(known.class);
    known.independent_at = known.last_seen.max(known.first_seen.plus_seconds(config.report_span_s));
}

fn dbh_std_m(std_m: f32, config: &Config) -> f64 {
    let std_m = f64::from(std_m);
    if std_m.is_finite() && std_m >= 0.0 { std_m.max(config.dbh_std_floor_m) } else { config.dbh_std_unknown_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{at, known};

    fn item() -> FleetObject {
        let mut object = known(5, 10.0, 20.0).to_message(at(0.0), &Config::default());
        (object.sightings, object.reported, object.confidence) = (4, 1, 2.0);
        (object.first_seen_ns, object.last_seen_ns) = (at(0.0).ns, at(9.0).ns);
        FleetObject { number: 1, weighed_ns: at(10.0).ns, object }
    }

    #[test]
    fn what_a_vehicle_reports_is_reported_here_and_never_from_the_future() {
        let config = Config::default();
        let known = parse(&item(), at(20.0), &config).unwrap();
        assert!(known.is_reported(at(20.0), &config));
        assert_eq!((known.id, known.place_m, known.weighed), (5, [10.0, 20.0], at(10.0)));
        let early = parse(&item(), at(2.0), &config).unwrap();
        assert_eq!((early.weighed, early.last_seen), (at(2.0), at(2.0)));
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_its_cause() {
        let refused = |change: fn(&mut FleetObject)| {
            let mut item = item();
            change(&mut item);
            parse(&item, at(20.0), &Config::default()).unwrap_err()
        };
        assert_eq!(refused(|i| i.object.easting_m = f64::NAN), Refusal::NotFinite);
        assert_eq!(refused(|i| i.object.northing_m = 1e300), Refusal::OffMap);
        assert_eq!(refused(|i| i.object.position_std_m = -1.0), Refusal::Unsure);
        assert_eq!(refused(|i| i.object.class = 77), Refusal::UnknownClass);
        assert_eq!(refused(|i| i.object.dbh_m = 1e9), Refusal::AbsurdSize);
    }
}
