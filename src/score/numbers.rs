//! Arrays from NumPy files: `.npy`, and `.npz` (a ZIP of them), which hold ground and labels of a plot.
//!
//! In: a file's bytes. Out: shapes and numbers as `f64`, row by row. Only little-endian numbers in C order are read.
//! Sources: the NumPy format specification (NEP 1), PKWARE's APPNOTE 6.3 (central directory; ZIP64 sizes are not
//! needed below 4 GB).

use flate2::read::DeflateDecoder;
use std::collections::BTreeMap;
use std::io::Read;

/// Most bytes of one array: a plot of 100 x 100 m at 0.15 m has 4 MB, its labels 20 MB.
const ARRAY_MAX: u64 = 1 << 30;

/// Numbers with their shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length along each axis; empty for a single number.
    pub shape: Vec<usize>,
    /// The numbers, the last axis fastest.
    pub values: Vec<f64>,
}

/// The arrays of an `.npz` file by name.
pub fn read_npz(bytes: &[u8]) -> Result<BTreeMap<String, Array>, String> {
    let entries = u16_at(bytes, end_of_directory(bytes)? + 10)?;
    let mut at = u32_at(bytes, end_of_directory(bytes)? + 16)? as usize;
    let mut arrays = BTreeMap::new();
    for _ in 0..entries {
        if bytes.get(at..at + 4) != Some(b"PK\x01\x02") {
            return Err(format!("byte {at}: no directory entry of a ZIP file there"));
        }
        let (method, packed, size) = (u16_at(bytes, at + 10)?, u32_at(bytes, at + 20)?, u32_at(bytes, at + 24)?);
        let lengths = [28, 30, 32].map(|field| u16_at(bytes, at + field).map(usize::from));
        let [name, extra, comment] = lengths;
        let (name, skipped) = (name?, extra? + comment?);
        let title = String::from_utf8_lossy(slice(bytes, at + 46, name)?).into_owned();
        let local = u32_at(bytes, at + 42)? as usize;
        let data = local + 30 + usize::from(u16_at(bytes, local + 26)?) + usize::from(u16_at(bytes, local + 28)?);
        let content = unpacked(slice(bytes, data, packed as usize)?, method, size)?;
        let array = read_npy(&content).map_err(|e| format!("{title}: {e}"))?;
        arrays.insert(title.trim_end_matches(".npy").to_owned(), array);
        at += 46 + name + skipped;
    }
    Ok(arrays)
}

fn end_of_directory(bytes: &[u8]) -> Result<usize, String> {
    let tail = bytes.len().saturating_sub(22 + 65_535);
    let found = bytes[tail..].windows(4).rposition(|w| w == b"PK\x05\x06").map(|at| tail + at);
    found.filter(|at| at + 22 <= bytes.len()).ok_or_else(|| "no end of a ZIP directory; is the file whole?".into())
}

fn unpacked(packed: &[u8], method: u16, size: u32) -> Result<Vec<u8>, String> {
    match method {
        0 => Ok(packed.to_vec()),
        8 => {
            let mut content = Vec::new();
            let limit = u64::from(size).min(ARRAY_MAX);
            DeflateDecoder::new(packed).take(limit).read_to_end(&mut content).map_err(|e| e.to_string())?;
            Ok(content)
        }
        other => Err(format!("compression method {other}; 0 and 8 are read")),
    }
}

/// An `.npy` file.
pub fn read_npy(bytes: &[u8]) -> Result<Array, String> {
    if bytes.get(..6) != Some(b"\x93NUMPY") {
        return Err("this is no .npy file".into());
    }
    let (start, length) = match bytes.get(6) {
        Some(1) => (10, usize::from(u16_at(bytes, 8)?)),
        _ => (12, u32_at(bytes, 8)? as usize),
    };
    let header = String::from_utf8_lossy(slice(bytes, start, length)?).into_owned();
    let data = &bytes[start + length..];
    if !header.contains("'fortran_order': False") {
        return Err("an array in Fortran order; C order is read".into());
    }
    let kind = between(&header, "'descr': '", "'")?;
    let shape = between(&header, "'shape': (", ")")?;
    let axis = |text: &str| text.parse().map_err(|_| format!("a length of '{text}'"));
    let shape: Vec<usize> =
        shape.split(',').map(str::trim).filter(|s| !s.is_empty()).map(axis).collect::<Result<_, _>>()?;
    let values = numbers(kind, data)?;
    if values.len() < shape.iter().product() {
        return Err(format!("{} numbers where the shape promises {:?}; the file is truncated", values.len(), shape));
    }
    Ok(Array { shape, values })
}

fn numbers(kind: &str, data: &[u8]) -> Result<Vec<f64>, String> {
    fn all<const N: usize>(data: &[u8], number: fn([u8; N]) -> f64) -> Vec<f64> {
        data.as_chunks::<N>().0.iter().map(|bytes| number(*bytes)).collect()
    }
    Ok(match kind {
        "<f8" => all(data, f64::from_le_bytes),
        "<f4" => all(data, |b| f32::from_le_bytes(b).into()),
        "<i8" => all(data, |b| i64::from_le_bytes(b) as f64),
        "<i4" => all(data, |b| i32::from_le_bytes(b).into()),
        "|u1" => all(data, |[b]: [u8; 1]| b.into()),
        other => return Err(format!("numbers of type '{other}'; <f8, <f4, <i8, <i4 and |u1 are read")),
    })
}

fn between<'t>(text: &'t str, before: &str, after: &str) -> Result<&'t str, String> {
    let rest = text.split_once(before).and_then(|(_, rest)| rest.split_once(after));
    rest.map(|(found, _)| found).ok_or_else(|| format!("a header without {before}"))
}

fn slice(bytes: &[u8], from: usize, length: usize) -> Result<&[u8], String> {
    let end = from.checked_add(length).filter(|end| *end <= bytes.len());
    end.map(|end| &bytes[from..end]).ok_or_else(|| format!("the file ends before byte {from} + {length}"))
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, String> {
    slice(bytes, at, 2).map(|b| u16::from_le_bytes([b[0], b[1]]))
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, String> {
    slice(bytes, at, 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::DeflateEncoder;
    use std::io::Write;

    fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({shape}), }}\n");
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        file.extend((header.len() as u16).to_le_bytes());
        [file.as_slice(), header.as_bytes(), data].concat()
    }

    /// A ZIP file with one packed entry: local header, data, directory, end.
    fn npz(name: &str, content: &[u8]) -> Vec<u8> {
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(content).unwrap();
        let packed = encoder.finish().unwrap();
        let sizes = [(packed.len() as u32).to_le_bytes(), (content.len() as u32).to_le_bytes()].concat();
        let mut file = b"PK\x03\x04\x14\0\0\0\x08\0\0\0\0\0\0\0\0\0".to_vec();
        file.extend([sizes.as_slice(), &(name.len() as u16).to_le_bytes(), &[0, 0], name.as_bytes(), &packed].concat());
        let directory = file.len() as u32;
        file.extend(b"PK\x01\x02\x14\0\x14\0\0\0\x08\0\0\0\0\0\0\0\0\0");
        file.extend([sizes.as_slice(), &(name.len() as u16).to_le_bytes(), &[0; 16], name.as_bytes()].concat());
        file.extend(b"PK\x05\x06\0\0\0\0\x01\0\x01\0");
        file.extend([46u32.to_le_bytes(), directory.to_le_bytes()].concat());
        file.extend([0, 0]);
        file
    }

    #[test]
    fn a_packed_array_comes_out_with_its_shape() {
        let data: Vec<u8> = [1.5f32, -2.0, 3.0, 4.0, 5.0, 6.25].iter().flat_map(|v| v.to_le_bytes()).collect();
        let arrays = read_npz(&npz("z.npy", &npy("<f4", "2, 3", &data))).unwrap();
        assert_eq!(arrays["z"], Array { shape: vec![2, 3], values: vec![1.5, -2.0, 3.0, 4.0, 5.0, 6.25] });
        assert_eq!(read_npy(&npy("<i8", "", &7i64.to_le_bytes())).unwrap(), Array { shape: vec![], values: vec![7.0] });
    }

    #[test]
    fn what_is_cut_or_foreign_is_an_error_and_never_a_panic() {
        let whole = npz("z.npy", &npy("|u1", "5,", &[1, 2, 3, 4, 5]));
        let mut refused = 0;
        for length in 0..whole.len() {
            refused += usize::from(read_npz(&whole[..length]).is_err());
        }
        assert_eq!(refused, whole.len());
        assert!(read_npy(&npy("<c8", "1,", &[0; 8])).unwrap_err().contains("<c8"));
        assert!(read_npy(&npy("|u1", "6,", &[0; 5])).unwrap_err().contains("truncated"));
    }
}
