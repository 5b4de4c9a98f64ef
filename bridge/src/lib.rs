//! The bridge crate of the Terrain Smart Sensor.
