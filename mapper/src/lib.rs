//! The mapper crate of the Terrain Smart Sensor.
