//! Tables `[[mapper.voxel_sensor]]`: who else may say what is free and what is occupied, and how far it is believed.

use serde::{Deserialize, Serialize};
use tsense_contract::{Checks, Fault};

/// Longest name that still fits the name of a service.
const NAME_MAX: usize = 31;

/// Most of them: each is a megabyte a sample in shared memory.
const SENSORS_MAX: usize = 16;

/// A sensor that sends voxels: a stereo camera, a radar, a saved map. Its index in the list is its number in the mapper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VoxelSensor {
    /// Name, the instance of its topic: `voxels/NAME`.
    pub name: String,
    /// How much its voxels count against a ladar of weight 1, above 0 to 1, in quarters.
    pub weight: f64,
    /// Voxels older than this when they arrive are dropped, seconds: the vehicle has moved on, and so has the world.
    pub age_max_s: f64,
    /// Silent for longer than this it is reported as missing, seconds; 0: never.
    pub silence_max_s: f64,
}

impl Default for VoxelSensor {
    fn default() -> Self {
        Self { name: "voxels".into(), weight: 0.5, age_max_s: 1.0, silence_max_s: 1.0 }
    }
}

/// All faults of a list, keys with their places in it.
pub fn validate(sensors: &[VoxelSensor]) -> Vec<Fault> {
    let mut check = Checks::default();
    check.count("voxel_sensor", sensors.len(), 0, SENSORS_MAX, "sensors");
    for (i, sensor) in sensors.iter().enumerate() {
        let mut of_one = Checks::below(&format!("voxel_sensor.{i}"));
        let plain = |b: u8| b.is_ascii_lowercase() || b.is_ascii_digit() || b"-_".contains(&b);
        let is_name = (1..=NAME_MAX).contains(&sensor.name.len()) && sensor.name.bytes().all(plain);
        of_one.require(is_name, "name", &sensor.name, "1 to 31 small letters, digits, - and _");
        let is_its_own = sensors[..i].iter().all(|other| other.name != sensor.name);
        of_one.require(is_its_own, "name", &sensor.name, "a name of its own: each sensor is a topic");
        let weight = sensor.weight;
        of_one.require(weight > 0.0 && weight <= 1.0, "weight", weight, "above 0, up to 1");
        of_one.range("age_max_s", sensor.age_max_s, 0.01, 60.0, "s");
        of_one.range("silence_max_s", sensor.silence_max_s, 0.0, 3600.0, "s");
        check.extend(of_one.into_faults());
    }
    check.into_faults()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sensor_is_checked_and_told_by_its_place() {
        let [good, odd] = ["stereo", "Rada/r"].map(|name| VoxelSensor { name: name.into(), ..VoxelSensor::default() });
        assert_eq!(validate(&[]), vec![]);
        assert_eq!(validate(std::slice::from_ref(&good)), vec![]);
        let odd = VoxelSensor { weight: f64::NAN, age_max_s: 0.0, silence_max_s: -1.0, ..odd };
        let keys: Vec<String> = validate(&[good.clone(), odd, good]).into_iter().map(|fault| fault.key).collect();
        let odd = ["name", "weight", "age_max_s", "silence_max_s"].map(|key| format!("voxel_sensor.1.{key}"));
        assert_eq!(keys, [&odd[..], &["voxel_sensor.2.name".into()]].concat());
        assert_eq!(validate(&vec![VoxelSensor::default(); 17])[0].key, "voxel_sensor");
    }
}
