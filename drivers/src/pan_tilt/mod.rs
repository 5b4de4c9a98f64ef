//! Driver of the pan-tilt unit: Directed Perception / FLIR commands and answers become stamped joint angles.
