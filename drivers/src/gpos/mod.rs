//! Driver of the position system: NMEA-0183 and NovAtel INSPVAX become poses of the vehicle in UTM.
