//! How `tsense objects` shows objects: a table for people, JSON, or GeoJSON.

use super::source::{History, Listing};
use super::{Failure, ObjectsArgs};
use serde_json::{Value, json};
use tsense_contract::{Class, Object};
use tsense_geometry::{NS_PER_S, Timestamp};
use tsense_kstore::persist::Entry;
use tsense_kstore::{Reprojection, Zone};

/// The listing as the arguments want it.
pub fn text(args: &ObjectsArgs, listing: &Listing) -> Result<String, Failure> {
    let value = match (args.json, args.geojson) {
        (true, _) => as_json(listing),
        (_, true) => as_geojson(listing),
        _ => return Ok(table(listing)),
    };
    serde_json::to_string_pretty(&value).map(|text| text + "\n").map_err(|e| Failure::new(1, e))
}

/// A number, or null where it is none; to a tenth of a millimetre, which is finer than anything measured here.
fn number(x: impl Into<f64>) -> Value {
    let x = x.into();
    if x.is_finite() { json!((x * 1e4).round() / 1e4) } else { Value::Null }
}

fn properties(o: &Object) -> Value {
    json!({
        "class": Class::from_wire(o.class).as_str(),
        "reported": o.reported == 1,
        "confidence": number(o.confidence),
        "sightings": o.sightings,
        "easting_m": number(o.easting_m),
        "northing_m": number(o.northing_m),
        "ground_m": number(o.ground_m),
        "position_std_m": number(o.position_std_m),
        "dbh_m": number(o.dbh_m),
        "dbh_std_m": number(o.dbh_std_m),
        "height_m": number(o.height_m),
        "first_seen_ns": o.first_seen_ns,
        "last_seen_ns": o.last_seen_ns,
    })
}

fn as_json(listing: &Listing) -> Value {
    let objects = listing.objects.iter().map(|o| {
        let mut object = properties(o);
        object["id"] = json!(o.id);
        object
    });
    json!({
        "epsg": listing.zone.map(Zone::epsg),
        "zone": listing.zone.map(|z| z.to_string()),
        "stored": listing.stored,
        "truncated": listing.truncated,
        "objects": objects.collect::<Vec<_>>(),
    })
}

/// Longitude and latitude on WGS 84, as GeoJSON demands; the UTM position stands in the properties.
fn as_geojson(listing: &Listing) -> Value {
    let degrees = listing.zone.and_then(Reprojection::to_degrees);
    let features = listing.objects.iter().map(|o| {
        let place = degrees.as_ref().and_then(|d| d.apply([o.easting_m, o.northing_m]));
        let geometry =
            place.map(|[longitude, latitude]| json!({"type": "Point", "coordinates": [longitude, latitude]}));
        json!({"type": "Feature", "id": o.id, "geometry": geometry, "properties": properties(o)})
    });
    json!({"type": "FeatureCollection", "features": features.collect::<Vec<_>>()})
}

/// Columns for people.
fn table(listing: &Listing) -> String {
    let head =
        ["id", "class", "easting m", "northing m", "+- m", "dbh m", "height m", "confidence", "seen", "last seen"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(listing.objects.iter().map(|o| row(o, listing.now)));
    let zone = listing.zone.map_or_else(|| "no zone".into(), |z| format!("zone {z}, EPSG:{}", z.epsg()));
    let text = format!("{} of {} stored objects, {zone}\n", listing.objects.len(), listing.stored);
    text + &aligned(&rows)
}

/// Columns aligned to the right.
fn aligned<const N: usize>(rows: &[[String; N]]) -> String {
    let widths: Vec<usize> = (0..N).map(|i| rows.iter().map(|row| row[i].chars().count()).max().unwrap_or(0)).collect();
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:>width$}"));
        text.push_str(&cells.collect::<Vec<_>>().join("  "));
        text.push('\n');
    }
    text
}

/// The changes of one object as the arguments want them.
pub fn history(args: &ObjectsArgs, id: u64, history: &History) -> Result<String, Failure> {
    if args.json {
        let entries: Vec<Value> = history.entries.iter().map(entry_json).collect();
        let text = serde_json::to_string_pretty(&json!({"id": id, "history": entries}));
        return text.map(|text| text + "\n").map_err(|e| Failure::new(1, e));
    }
    let head = ["when", "what", "easting m", "northing m", "EPSG", "confidence", "seen"];
    let mut rows = vec![head.map(str::to_owned)];
    rows.extend(history.entries.iter().map(|e| entry_row(e, history.now)));
    Ok(format!("object {id}, oldest change first\n{}", aligned(&rows)))
}

fn entry_json(e: &Entry) -> Value {
    json!({
        "stamp_ns": e.stamp.ns,
        "reason": e.reason,
        "other_id": e.other,
        "epsg": e.epsg,
        "easting_m": number(e.place_m[0]),
        "northing_m": number(e.place_m[1]),
        "confidence": number(e.confidence),
        "sightings": e.sightings,
    })
}

fn entry_row(e: &Entry, now: Timestamp) -> [String; 7] {
    [
        age(now.ns.saturating_sub(e.stamp.ns)),
        e.other.map_or_else(|| e.reason.clone(), |other| format!("{} {other}", e.reason)),
        format!("{:.2}", e.place_m[0]),
        format!("{:.2}", e.place_m[1]),
        e.epsg.to_string(),
        format!("{:.2}", e.confidence),
        format!("{}x", e.sightings),
    ]
}

fn row(o: &Object, now: Timestamp) -> [String; 10] {
    let metres = |x: f32| if x.is_finite() { format!("{x:.2}") } else { "-".into() };
    let mark = if o.reported == 1 { "" } else { "?" };
    [
        o.id.to_string(),
        format!("{}{mark}", Class::from_wire(o.class)),
        format!("{:.2}", o.easting_m),
        format!("{:.2}", o.northing_m),
        metres(o.position_std_m),
        metres(o.dbh_m),
        metres(o.height_m),
        format!("{:.2}", o.confidence),
        format!("{}x", o.sightings),
        age(now.ns.saturating_sub(o.last_seen_ns)),
    ]
}

/// How long ago, in the unit that fits.
fn age(ns: i64) -> String {
    match ns / NS_PER_S {
        i64::MIN..0 => "in the future".into(),
        s @ 0..120 => format!("{s} s ago"),
        s @ 120..7_200 => format!("{} min ago", s / 60),
        s @ 7_200..172_800 => format!("{} h ago", s / 3_600),
        s => format!("{} d ago", s / 86_400),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tsense_kstore::{KnowledgeStore, Known, View};

    fn at(seconds: f64) -> Timestamp {
        Timestamp::from_ns(1_700_000_000_000_000_000).plus_seconds(seconds)
    }

    /// Three trees seen four times, one of them twenty metres off.
    fn store() -> KnowledgeStore {
        let mut store = KnowledgeStore::new(tsense_kstore::Config::default());
        let zone = Zone::from_epsg(32_617).unwrap();
        let tree = |east: f64| tsense_contract::Detection {
            easting_m: 500_000.0 + east,
            northing_m: 0.0,
            ground_m: 100.0,
            position_std_m: 0.05,
            dbh_m: 0.3,
            dbh_std_m: 0.02,
            height_m: f32::NAN,
            confidence: 0.9,
            arc_coverage: 0.4,
            lean_rad: [0.0; 2],
            class: Class::Tree.to_wire(),
            stamp_ns: 0,
            reserved: [0; 7],
        };
        for i in 0..4 {
            let snapshot =
                tsense_kstore::Snapshot { stamp: at(2.0 * f64::from(i)), vehicle_m: [500_000.0, 0.0], zone, epoch: 1 };
            store.take(&snapshot, &[0.0, 3.0, 20.0].map(tree), |_| View::Unseen);
        }
        assert!(store.objects().all(|o: &Known| o.is_reported(at(6.0), store.config())));
        store
    }

    fn args(words: &[&str]) -> ObjectsArgs {
        #[derive(clap::Parser)]
        struct Command {
            #[command(flatten)]
            args: ObjectsArgs,
        }
        let words = ["objects"].iter().chain(words);
        <Command as clap::Parser>::try_parse_from(words).unwrap().args
    }

    fn said(words: &[&str]) -> String {
        let (args, store) = (args(words), store());
        let answer = store.query(&crate::commands::objects::query(&args), at(66.0));
        let (stored, zone) = (store.len() as u64, store.zone());
        let (objects, truncated, origin) = (answer.objects, answer.truncated, String::new());
        text(&args, &Listing { objects, truncated, stored, zone, now: at(66.0), origin }).unwrap()
    }

    #[test]
    fn the_table_names_the_zone_and_the_nearest_object_first() {
        let table = said(&["--near", "500003,0", "--radius", "10"]);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines[0], "2 of 3 stored objects, zone 17N, EPSG:32617");
        let words: Vec<&str> = lines[2].split_whitespace().collect();
        assert_eq!(words[..4], ["2", "tree", "500003.00", "0.00"]);
        assert!(lines[2].ends_with("60 s ago") && lines[2].contains("4x") && lines.len() == 4, "{table}");
    }

    #[test]
    fn a_history_tells_when_and_why_oldest_first() {
        let entry = |seconds, reason: &str, other| Entry {
            stamp: at(seconds),
            reason: reason.into(),
            other,
            epsg: 32_617,
            place_m: [500_003.0, 0.0],
            confidence: 1.5,
            sightings: 3,
        };
        let history = History {
            entries: vec![entry(0.0, "first seen", None), entry(6.0, "united with", Some(9))],
            now: at(66.0),
        };
        let table = super::history(&args(&["--history", "2"]), 2, &history).unwrap();
        let lines: Vec<&str> = table.lines().collect();
        let words: Vec<&str> = lines[2].split_whitespace().collect();
        assert_eq!(words, ["66", "s", "ago", "first", "seen", "500003.00", "0.00", "32617", "1.50", "3x"]);
        assert!(lines[3].contains("60 s ago  united with 9"), "{table}");
        let json: Value =
            serde_json::from_str(&super::history(&args(&["--history", "2", "--json"]), 2, &history).unwrap()).unwrap();
        assert_eq!((&json["history"][1]["other_id"], &json["history"][0]["other_id"]), (&json!(9), &Value::Null));
    }

    #[test]
    fn json_has_null_where_nothing_was_measured() {
        let json: Value = serde_json::from_str(&said(&["--json", "--class", "tree"])).unwrap();
        assert_eq!((json["epsg"].as_i64(), json["stored"].as_i64()), (Some(32_617), Some(3)));
        let tree = &json["objects"][0];
        assert_eq!((&tree["id"], &tree["height_m"], &tree["dbh_m"]), (&json!(1), &Value::Null, &json!(0.3)));
        let rocks: Value = serde_json::from_str(&said(&["--json", "--class", "rock"])).unwrap();
        assert_eq!(rocks["objects"], json!([]));
    }

    /// The central meridian of zone 17 is 81 degrees west.
    #[test]
    fn geojson_is_in_degrees() {
        let json: Value = serde_json::from_str(&said(&["--geojson", "--near", "500000,0", "--radius", "1"])).unwrap();
        let at = &json["features"][0]["geometry"]["coordinates"];
        assert!((at[0].as_f64().unwrap() + 81.0).abs() < 1e-6 && at[1].as_f64().unwrap().abs() < 1e-6, "{json}");
    }

    #[test]
    fn ages_read_as_people_write_them() {
        assert_eq!(
            [59, 150, 7_300, 200_000].map(|s| age(s * NS_PER_S)),
            ["59 s ago", "2 min ago", "2 h ago", "2 d ago"]
        );
    }
}
