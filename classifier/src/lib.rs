//! The classifier crate of the Terrain Smart Sensor.
