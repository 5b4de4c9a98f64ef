//! `tsense`: the command line and the launcher of the Terrain Smart Sensor.
#![allow(dead_code)]
mod config;

fn main() {}
