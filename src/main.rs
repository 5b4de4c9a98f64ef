//! `tsense`: the command line and the launcher of the Terrain Smart Sensor.

fn main() {}
