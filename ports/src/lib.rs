//! The ports crate of the Terrain Smart Sensor.
