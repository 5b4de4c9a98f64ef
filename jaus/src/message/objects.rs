//! Objects as the World Model Vector Knowledge Store of RA 3.x has them. EXPERIMENTAL: never standardised in AS-4.
//!
//! Codes and layout are those of RA 3.x, its signed scaled integers included; the transport around is AS5669A.
//! Feature classes with attributes of our own are listed in `docs/jaus.md`.

use super::scaled::{SignedLatitude, SignedLongitude};
use super::{Field, List8, List16};
use crate::bytes::{Malformed, Reader, Writer};

/// Kind of an object: a point.
pub const POINT: u8 = 0;
/// Kind of an object: a line.
pub const LINE: u8 = 1;
/// Kind of an object: an area.
pub const POLYGON: u8 = 2;

/// Value of a feature class's attribute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Attribute {
    /// Type 0.
    Byte(u8),
    /// Type 1.
    Short(i16),
    /// Type 5.
    UnsignedInteger(u32),
    /// Type 7.
    Float(f32),
    /// Type 8.
    Double(f64),
}

impl Field for Attribute {
    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        match reader.u8()? {
            0 => reader.u8().map(Self::Byte),
            1 => reader.i16().map(Self::Short),
            5 => reader.u32().map(Self::UnsignedInteger),
            7 => reader.f32().map(Self::Float),
            8 => reader.f64().map(Self::Double),
            _ => Err(Malformed::Tag),
        }
    }
    fn write(&self, out: &mut Writer) {
        match self {
            Self::Byte(value) => {
                out.u8(0);
                out.u8(*value);
            }
            Self::Short(value) => {
                out.u8(1);
                out.i16(*value);
            }
            Self::UnsignedInteger(value) => {
                out.u8(5);
                out.u32(*value);
            }
            Self::Float(value) => {
                out.u8(7);
                out.f32(*value);
            }
            Self::Double(value) => {
                out.u8(8);
                out.f64(*value);
            }
        }
    }
}

impl Default for Attribute {
    fn default() -> Self {
        Self::Byte(0)
    }
}

records! {
    /// What an object is, and how much of it.
    FeatureClass {
        /// Which feature.
        id: u16,
        /// Its value.
        attribute: Attribute,
    }
    /// A corner of an object.
    ObjectPoint {
        /// Degrees.
        latitude: SignedLatitude,
        /// Degrees.
        longitude: SignedLongitude,
    }
    /// An object.
    VectorObject {
        /// Its number in the store.
        id: u32,
        /// [`POINT`], [`LINE`], [`POLYGON`].
        kind: u8,
        /// How far it reaches around its points, metres.
        buffer_m: f32,
        /// What it is.
        features: List8<FeatureClass>,
        /// Where it is.
        points: List16<ObjectPoint>,
    }
}

/// Asks for objects.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QueryVectorObjects {
    /// Which parts of the answer are wanted: bit 0 the objects, else their number alone.
    pub response: u8,
    /// Comes back in the answer.
    pub request: u8,
    /// Only these.
    pub ids: Option<List16<u32>>,
    /// Only what lies in this region.
    pub region: Option<Region>,
    /// Only of these feature classes.
    pub features: Option<List8<u16>>,
}

/// A region that objects are asked for in.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// [`POINT`], [`LINE`], [`POLYGON`].
    pub kind: u8,
    /// How far around its points, metres.
    pub buffer_m: Option<f32>,
    /// Where.
    pub points: Vec<ObjectPoint>,
}

/// Bits of the query's presence vector.
const IDS: u8 = 1;
const REGION: u8 = 2;
const BUFFER: u8 = 4;
const FEATURES: u8 = 8;
const FEATURE_LIST: u8 = 16;
const POINTS: u8 = 64;

impl crate::Message for QueryVectorObjects {
    const CODE: u16 = 0x2A23;

    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let present = reader.u8()?;
        let has = |bit: u8| present & bit != 0;
        let (response, request) = (reader.u8()?, reader.u8()?);
        if present & !(IDS | REGION | BUFFER | FEATURES | FEATURE_LIST | POINTS) != 0 {
            // Bit 5 filters by attribute, bit 7 is nothing we know: the rest cannot be read.
            return Err(Malformed::Value);
        }
        let ids = if has(IDS) { Some(Field::read(reader)?) } else { None };
        let mut region = None;
        if has(REGION) {
            let kind = reader.u8()?;
            let buffer_m = if has(BUFFER) { Some(reader.f32()?) } else { None };
            region = Some(Region { kind, buffer_m, points: Vec::new() });
        }
        let features = if has(FEATURES) || has(FEATURE_LIST) { Some(Field::read(reader)?) } else { None };
        if has(POINTS) {
            let List16(points) = Field::read(reader)?;
            region.get_or_insert_default().points = points;
        }
        Ok(Self { response, request, ids, region, features })
    }

    fn write(&self, out: &mut Writer) {
        let bit = |here: bool, bit: u8| if here { bit } else { 0 };
        let region = self.region.as_ref();
        out.u8(bit(self.ids.is_some(), IDS)
            | bit(region.is_some(), REGION | POINTS)
            | bit(region.is_some_and(|r| r.buffer_m.is_some()), BUFFER)
            | bit(self.features.is_some(), FEATURES | FEATURE_LIST));
        out.u8(self.response);
        out.u8(self.request);
        if let Some(ids) = &self.ids {
            ids.write(out);
        }
        if let Some(region) = region {
            out.u8(region.kind);
            if let Some(buffer_m) = region.buffer_m {
                out.f32(buffer_m);
            }
        }
        if let Some(features) = &self.features {
            features.write(out);
        }
        if let Some(region) = region {
            List16(region.points.clone()).write(out);
        }
    }
}

/// Objects, or how many there are.
#[derive(Clone, Debug, PartialEq)]
pub struct ReportVectorObjects {
    /// That of the query.
    pub request: u8,
    /// How many there are; where the objects are there it is their number.
    pub count: u16,
    /// The objects, where they were asked for.
    pub objects: Option<Vec<VectorObject>>,
}

impl crate::Message for ReportVectorObjects {
    const CODE: u16 = 0x4A23;

    fn read(reader: &mut Reader<'_>) -> Result<Self, Malformed> {
        let (present, request, count) = (reader.u8()?, reader.u8()?, reader.u16()?);
        let objects = match present {
            0 => None,
            1 => Some((0..count).map(|_| Field::read(reader)).collect::<Result<_, _>>()?),
            _ => return Err(Malformed::Value),
        };
        Ok(Self { request, count, objects })
    }

    fn write(&self, out: &mut Writer) {
        out.u8(u8::from(self.objects.is_some()));
        out.u8(self.request);
        out.u16(self.count);
        for object in self.objects.iter().flatten().take(usize::from(self.count)) {
            object.write(out);
        }
    }
}
