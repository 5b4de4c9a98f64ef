//! The kstore crate of the Terrain Smart Sensor.
