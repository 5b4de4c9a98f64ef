//! The simulator crate of the Terrain Smart Sensor.
