//! Driver of the SICK LMS-151 laser scanner: CoLa-A and CoLa-B over TCP become stamped scans.
