//! The drivers crate of the Terrain Smart Sensor.
