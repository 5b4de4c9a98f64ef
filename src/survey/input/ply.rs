//! Ray clouds: binary little-endian PLY, one vertex a ray.
//!
//! x y z is the end point (UTM, metres), nx ny nz the vector from the end point back to the sensor, time in
//! seconds, alpha 0 where nothing came back. Properties may come in any order and any numeric type; others are
//! skipped. Source: the ray-cloud convention of raycloudtools.
#![allow(clippy::disallowed_methods, reason = "shell: the survey's input files")]

use super::{Clock, InputError, Ray, Rays, System, TIME_MAX_S};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use tsense_geometry::{COORDINATE_MAX_M, Point, Timestamp, Vector};

/// Longest header that is read: real ones have some 400 bytes.
const HEADER_MAX: usize = 64 * 1024;
/// Vertices that are read at once, bytes: more than a reader's buffer, so that they come without a copy.
const CHUNK: usize = 64 * 1024;
/// The properties a ray needs, in the order of [`Layout::places`].
const NEEDED: [&str; 8] = ["x", "y", "z", "time", "nx", "ny", "nz", "alpha"];
/// Their types in nearly all ray clouds: these are read without asking each one's type.
const USUAL: [Number; 8] =
    [Number::F64, Number::F64, Number::F64, Number::F64, Number::F32, Number::F32, Number::F32, Number::U8];

/// Numeric types of PLY, and their names.
#[derive(Clone, Copy, PartialEq)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    fn read(self, b: &[u8]) -> f64 {
        match self {
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            Self::F64 => f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]),
        }
    }
}

/// Where each needed property lies in a vertex.
struct Layout {
    places: [(Number, usize); 8],
    stride: usize,
    vertices: u64,
    /// Bytes of the header.
    data_start: u64,
}

/// Opens a ray cloud.
pub fn open(path: &Path) -> Result<Rays, InputError> {
    let file = File::open(path).map_err(|e| InputError::io(path, &e))?;
    let length = file.metadata().map_err(|e| InputError::io(path, &e))?.len();
    read(path, length, BufReader::new(file))
}

/// Reads a ray cloud of `length` bytes; `path` is what errors call it.
pub fn read(path: &Path, length: u64, mut reader: impl BufRead + 'static) -> Result<Rays, InputError> {
    let layout = read_header(path, &mut reader)?;
    let expected = layout.data_start + layout.vertices.saturating_mul(layout.stride as u64);
    if length < expected {
        return Err(InputError::new(
            path,
            &format!("the file ends here, but its header promises {} rays, {expected} bytes", layout.vertices),
            "copy the file again; it is truncated",
        )
        .at_byte(length));
    }
    let total = layout.vertices;
    let is_usual = layout.places.map(|(number, _)| number) == USUAL;
    let iter = Vertices { path: path.into(), reader, layout, is_usual, chunk: Vec::new(), at: 0, next: 0 };
    Ok(Rays { total: Some(total), clock: Clock::Seconds, system: System::Unknown, iter: Box::new(iter) })
}

struct Vertices<R> {
    path: PathBuf,
    reader: R,
    layout: Layout,
    is_usual: bool,
    /// Whole vertices, and where the next one starts.
    chunk: Vec<u8>,
    at: usize,
    /// The next vertex, counted from the first one.
    next: u64,
}

impl<R: Read> Iterator for Vertices<R> {
    type Item = Result<Ray, InputError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next >= self.layout.vertices {
            return None;
        }
        let byte = self.layout.data_start + self.next * self.layout.stride as u64;
        if self.at == self.chunk.len()
            && let Err(error) = self.read_chunk()
        {
            self.next = self.layout.vertices;
            return Some(Err(InputError::io(&self.path, &error).at_byte(byte)));
        }
        let vertex = &self.chunk[self.at..self.at + self.layout.stride];
        let ray = self.ray(vertex, byte);
        (self.at, self.next) = (self.at + self.layout.stride, self.next + 1);
        Some(ray)
    }
}

impl<R: Read> Vertices<R> {
    fn read_chunk(&mut self) -> std::io::Result<()> {
        let stride = self.layout.stride;
        let left = self.layout.vertices - self.next;
        let vertices = left.min((CHUNK / stride).max(1) as u64) as usize;
        self.chunk.resize(vertices * stride, 0);
        self.at = 0;
        self.reader.read_exact(&mut self.chunk)
    }
}

impl<R> Vertices<R> {
    fn ray(&self, vertex: &[u8], byte: u64) -> Result<Ray, InputError> {
        let places = &self.layout.places;
        let [x, y, z, time, nx, ny, nz, alpha] = match self.is_usual {
            true => {
                let double = |i: usize| f64::from_le_bytes(bytes_at(vertex, places[i].1));
                let single = |i: usize| f64::from(f32::from_le_bytes(bytes_at(vertex, places[i].1)));
                let alpha = f64::from(vertex[places[7].1]);
                [double(0), double(1), double(2), double(3), single(4), single(5), single(6), alpha]
            }
            false => places.map(|(number, offset)| number.read(&vertex[offset..])),
        };
        // No short way out: six comparisons cost less than one that is guessed wrongly. NaN is beyond any bound.
        let near = |a: f64, b: f64, c: f64| {
            (a.abs() <= COORDINATE_MAX_M) & (b.abs() <= COORDINATE_MAX_M) & (c.abs() <= COORDINATE_MAX_M)
        };
        let sound = near(x, y, z) & near(nx, ny, nz) & (time.abs() <= TIME_MAX_S);
        if !sound {
            let seen = format!("a ray with x {x:?}, y {y:?}, z {z:?}, time {time:?}, back ({nx:?}, {ny:?}, {nz:?})");
            return Err(InputError::new(
                &self.path,
                &seen,
                "rays must be finite, on the Earth and before the year 2262",
            )
            .at_byte(byte));
        }
        let end = Point::new(x, y, z);
        Ok(Ray {
            origin: end + Vector::new(nx, ny, nz),
            end,
            is_return: alpha > 0.0,
            stamp: Timestamp::from_seconds(time),
        })
    }
}

#[inline]
fn bytes_at<const N: usize>(vertex: &[u8], offset: usize) -> [u8; N] {
    // The layout's places lie within its stride; so written, it is a load and no call.
    *vertex[offset..].first_chunk().unwrap_or(&[0; N])
}

fn read_header(path: &Path, reader: &mut impl BufRead) -> Result<Layout, InputError> {
    let fault = |line: usize, seen: &str| {
        InputError::new(path, seen, "give a binary little-endian ray cloud: x y z time nx ny nz red green blue alpha")
            .at_line(line)
    };
    let mut properties: Vec<(String, Number, usize)> = Vec::new();
    let (mut stride, mut vertices, mut bytes, mut in_vertex, mut binary) = (0, None, 0, false, false);
    for line_number in 1.. {
        let mut line = Vec::new();
        let read = reader
            .by_ref()
            .take(HEADER_MAX as u64)
            .read_until(b'\n', &mut line)
            .map_err(|e| InputError::io(path, &e))?;
        bytes += read;
        if read == 0 || bytes > HEADER_MAX {
            return Err(fault(line_number, "no end_header"));
        }
        let text = String::from_utf8_lossy(&line);
        let words: Vec<&str> = text.split_whitespace().collect();
        match words.as_slice() {
            ["ply"] if line_number == 1 => {}
            _ if line_number == 1 => return Err(fault(1, "this is no PLY file")),
            ["format", "binary_little_endian", _] => binary = true,
            ["format", other, ..] => return Err(fault(line_number, &format!("format '{other}'"))),
            ["element", "vertex", count] => {
                vertices = count.parse::<u64>().ok();
                in_vertex = true;
            }
            ["element", ..] if vertices.is_none() => {
                return Err(fault(line_number, "an element before the vertices"));
            }
            ["element", ..] => in_vertex = false,
            ["property", "list", ..] if in_vertex => return Err(fault(line_number, "a list property in a vertex")),
            ["property", kind, name] if in_vertex => {
                let number = Number::parse(kind).ok_or_else(|| fault(line_number, &format!("type '{kind}'")))?;
                properties.push(((*name).to_owned(), number, stride));
                stride += number.size();
            }
            ["end_header"] => break,
            _ => {}
        }
    }
    let vertices = vertices.filter(|_| binary).ok_or_else(|| fault(2, "no binary vertices"))?;
    let mut places = [(Number::U8, 0); 8];
    for (place, needed) in places.iter_mut().zip(NEEDED) {
        let found = properties.iter().find(|(name, ..)| name == needed);
        let (_, number, offset) = found.ok_or_else(|| fault(2, &format!("no property '{needed}'")))?;
        *place = (*number, *offset);
    }
    Ok(Layout { places, stride, vertices, data_start: bytes as u64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_at_no_time_is_refused_where_it_stands() {
        for time in [f64::NAN, 1e300] {
            let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\n".to_vec();
            for name in ["x", "y", "z", "time", "nx", "ny", "nz", "alpha"] {
                bytes.extend(format!("property double {name}\n").bytes());
            }
            bytes.extend(b"end_header\n");
            let head = bytes.len();
            [1.0, 2.0, 3.0, time, 0.0, 0.0, 1.0, 1.0].iter().for_each(|value: &f64| bytes.extend(value.to_le_bytes()));
            let mut rays = read(Path::new("a.ply"), bytes.len() as u64, std::io::Cursor::new(bytes)).unwrap();
            let told = rays.next().unwrap().unwrap_err().to_string();
            assert!(told.contains(&format!("byte {head}: ")) && told.contains(&format!("time {time:?}")), "{told}");
        }
    }

    /// A ray cloud with `count` rays and the given properties, each with its value in the ray `i`.
    fn cloud(count: u32, properties: &[(&str, &str)], put: impl Fn(&str, &str, u32) -> Vec<u8>) -> Vec<Ray> {
        let lines: String = properties.iter().map(|(kind, name)| format!("property {kind} {name}\n")).collect();
        let header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {count}\n{lines}end_header\n");
        let mut bytes = header.into_bytes();
        for i in 0..count {
            properties.iter().for_each(|(kind, name)| bytes.extend(put(kind, name, i)));
        }
        let length = bytes.len() as u64;
        read(Path::new("a.ply"), length, std::io::Cursor::new(bytes)).unwrap().map(Result::unwrap).collect()
    }

    #[test]
    fn rays_are_the_same_whatever_the_order_and_the_types_of_their_properties() {
        let value = |name: &str, i: u32| match name {
            "x" => 100.5 + f64::from(i),
            "y" => 200.25,
            "z" => 3.0,
            "time" => 0.5 * f64::from(i),
            "nx" => -2.0,
            "nz" => 1.5,
            "alpha" => f64::from(i % 2),
            _ => 0.0,
        };
        let put = |kind: &str, name: &str, i: u32| match kind {
            "double" => value(name, i).to_le_bytes().to_vec(),
            "float" => (value(name, i) as f32).to_le_bytes().to_vec(),
            _ => vec![value(name, i) as u8],
        };
        let [d, f, u] = ["double", "float", "uchar"];
        let usual =
            [(d, "x"), (d, "y"), (d, "z"), (d, "time"), (f, "nx"), (f, "ny"), (f, "nz"), (u, "red"), (u, "alpha")];
        let other = [(u, "alpha"), (f, "nz"), (f, "ny"), (d, "nx"), (f, "time"), (d, "z"), (f, "y"), (f, "x")];
        // More than two chunks.
        let rays = cloud(4000, &usual, put);
        assert_eq!(rays, cloud(4000, &other, put));
        assert_eq!((rays.len(), rays[3].end.to_array()), (4000, [103.5, 200.25, 3.0]));
        assert_eq!((rays[3].origin.to_array(), rays[3].is_return), ([101.5, 200.25, 4.5], true));
        assert_eq!((rays[3].stamp, rays[2].is_return), (Timestamp::from_seconds(1.5), false));
    }
}
