//! Names and units of a GeoTIFF's bands, as GDAL keeps them: an XML text under tag 42112 of the first directory.
//!
//! In: a file that `geotiff-writer` has written, which has no call for that tag. Out: the same file with it. What lies
//! behind the directory moves, and every offset with it, so the order of a cloud-optimised file stays. Source: TIFF 6.0,
//! BigTIFF, GDAL's GeoTIFF driver ("GDAL_METADATA").
#![allow(clippy::disallowed_methods, reason = "shell: changes a file of the survey")]

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// What the values of a band are.
#[derive(Clone, Copy, Debug)]
pub struct Band {
    /// Its name, as people read it.
    pub name: &'static str,
    /// Its unit; "1" where there is none, since GDAL would take that of the heights.
    pub unit: &'static str,
}

/// Tags of offsets of blocks, and of GDAL's texts.
const TILE_OFFSETS: u64 = 324;
const GDAL_METADATA: u64 = 42_112;
/// TIFF's type of texts.
const ASCII: u64 = 2;
/// Bytes that move at a time.
const CHUNK_BYTES: u64 = 1 << 20;

/// Writes the bands' names and units into the file.
pub fn name_bands(path: &Path, bands: &[Band]) -> io::Result<()> {
    let tiff = Tiff::open(OpenOptions::new().read(true).write(true).open(path)?)?;
    let text = metadata(bands);
    let shift = tiff.entry_bytes() + text.len() as u64;
    let length = tiff.file.metadata()?.len();
    if !tiff.is_big && length + shift > u64::from(u32::MAX) {
        // Too long for offsets of 32 bits: bands without names are better than no file.
        return Ok(());
    }
    let first = tiff.directory(tiff.first)?;
    let mut next = Some(first.clone());
    while let Some(directory) = next {
        next = tiff.move_offsets(&directory, shift)?;
    }
    let before = first.entries.iter().take_while(|entry| entry.tag < GDAL_METADATA).count() as u64;
    let at = first.entries_at + before * tiff.entry_bytes();
    // What follows the new entry in the directory, its end included.
    let mut moved = vec![0; (first.end - at) as usize];
    tiff.file.read_exact_at(&mut moved, at)?;
    move_up(&tiff.file, first.end, length, shift)?;
    let mut inserted = tiff.entry(GDAL_METADATA, ASCII, text.len() as u64, first.end + tiff.entry_bytes());
    inserted.append(&mut moved);
    inserted.extend(text);
    tiff.file.write_all_at(&inserted, at)?;
    tiff.write(first.at, tiff.count_bytes(), first.entries.len() as u64 + 1)
}

/// GDAL's text, ended by one zero and of an even length, so that what follows keeps to words.
fn metadata(bands: &[Band]) -> Vec<u8> {
    let item = |(sample, band): (usize, &Band)| {
        let line = |name: &str, value: &str| {
            let role = name.to_ascii_lowercase();
            format!("  <Item name=\"{name}\" sample=\"{sample}\" role=\"{role}\">{value}</Item>\n")
        };
        line("DESCRIPTION", band.name) + &line("UNITTYPE", band.unit)
    };
    let items: String = bands.iter().enumerate().map(item).collect();
    let mut text = format!("<GDALMetadata>\n{items}</GDALMetadata>\n");
    if text.len().is_multiple_of(2) {
        text.push('\n');
    }
    text.push('\0');
    text.into_bytes()
}

/// Moves what lies between two places up by so many bytes, from its end on.
fn move_up(file: &File, from: u64, mut to: u64, shift: u64) -> io::Result<()> {
    let mut chunk = vec![0; CHUNK_BYTES as usize];
    while to > from {
        let chunk = &mut chunk[..CHUNK_BYTES.min(to - from) as usize];
        to -= chunk.len() as u64;
        file.read_exact_at(chunk, to)?;
        file.write_all_at(chunk, to + shift)?;
    }
    Ok(())
}

/// A little-endian TIFF or BigTIFF.
struct Tiff {
    file: File,
    is_big: bool,
    /// Where the first directory lies.
    first: u64,
}

/// A directory: a count, entries, the place of the next one.
#[derive(Clone)]
struct Directory {
    at: u64,
    entries_at: u64,
    next_at: u64,
    end: u64,
    entries: Vec<Entry>,
}

#[derive(Clone)]
struct Entry {
    tag: u64,
    /// Bytes of one value, and how many there are.
    item_bytes: u64,
    count: u64,
    /// Where the values lie, or their offset.
    value_at: u64,
}

impl Tiff {
    fn open(file: File) -> io::Result<Self> {
        let mut tiff = Self { file, is_big: false, first: 0 };
        tiff.is_big = match tiff.read(0, 4)? {
            0x002a_4949 => false,
            0x002b_4949 => true,
            _ => return Err(corrupt()),
        };
        tiff.first = if tiff.is_big { tiff.read(8, 8)? } else { tiff.read(4, 4)? };
        Ok(tiff)
    }

    fn offset_bytes(&self) -> u64 {
        if self.is_big { 8 } else { 4 }
    }

    fn count_bytes(&self) -> u64 {
        if self.is_big { 8 } else { 2 }
    }

    /// Tag and type of two bytes each, the count, the value.
    fn entry_bytes(&self) -> u64 {
        4 + 2 * self.offset_bytes()
    }

    fn entry(&self, tag: u64, kind: u64, count: u64, value: u64) -> Vec<u8> {
        let part = |number: u64, bytes: u64| number.to_le_bytes().into_iter().take(bytes as usize);
        let offset = self.offset_bytes();
        part(tag, 2).chain(part(kind, 2)).chain(part(count, offset)).chain(part(value, offset)).collect()
    }

    fn read(&self, at: u64, bytes: u64) -> io::Result<u64> {
        let mut number = [0; 8];
        self.file.read_exact_at(&mut number[..bytes as usize], at)?;
        Ok(u64::from_le_bytes(number))
    }

    fn write(&self, at: u64, bytes: u64, number: u64) -> io::Result<()> {
        self.file.write_all_at(&number.to_le_bytes()[..bytes as usize], at)
    }

    fn directory(&self, at: u64) -> io::Result<Directory> {
        let entries_at = at + self.count_bytes();
        let entry = |i: u64| {
            let at = entries_at + i * self.entry_bytes();
            let item_bytes = match self.read(at + 2, 2)? {
                1 | 2 | 6 | 7 => 1,
                3 | 8 => 2,
                4 | 9 | 11 | 13 => 4,
                5 | 10 | 12 | 16 | 17 | 18 => 8,
                _ => return Err(corrupt()),
            };
            let (tag, count) = (self.read(at, 2)?, self.read(at + 4, self.offset_bytes())?);
            Ok(Entry { tag, item_bytes, count, value_at: at + 4 + self.offset_bytes() })
        };
        let entries = (0..self.read(at, self.count_bytes())?).map(entry).collect::<io::Result<Vec<_>>>()?;
        let next_at = entries_at + entries.len() as u64 * self.entry_bytes();
        Ok(Directory { at, entries_at, next_at, end: next_at + self.offset_bytes(), entries })
    }

    /// Adds to every offset of a directory; the next directory, where it lies now.
    fn move_offsets(&self, directory: &Directory, shift: u64) -> io::Result<Option<Directory>> {
        for entry in &directory.entries {
            let is_inline = entry.item_bytes * entry.count <= self.offset_bytes();
            let values_at =
                if is_inline { entry.value_at } else { self.moved(entry.value_at, self.offset_bytes(), shift)? };
            if entry.tag == TILE_OFFSETS {
                for i in 0..entry.count {
                    self.moved(values_at + i * entry.item_bytes, entry.item_bytes, shift)?;
                }
            }
        }
        let next = self.moved(directory.next_at, self.offset_bytes(), shift)?;
        if next == 0 { Ok(None) } else { self.directory(next).map(Some) }
    }

    /// Adds to the offset at a place, but not to the zero that stands for nothing; what it was.
    fn moved(&self, at: u64, bytes: u64, shift: u64) -> io::Result<u64> {
        let offset = self.read(at, bytes)?;
        if offset != 0 {
            self.write(at, bytes, offset + shift)?;
        }
        Ok(offset)
    }
}

fn corrupt() -> io::Error {
    io::Error::new(ErrorKind::InvalidData, "this is no TIFF that names can be written into")
}

#[cfg(test)]
mod tests {
    use super::*;
    use geotiff_writer::{CogBuilder, GeoTiffBuilder, TiffVariant};
    use tiff::decoder::{Decoder, DecodingResult};
    use tiff::tags::Tag;

    const BANDS: [Band; 2] = [Band { name: "cost", unit: "of 253" }, Band { name: "height", unit: "m" }];

    /// A small raster with overviews and a block that nobody wrote.
    fn raster(path: &Path, variant: TiffVariant) {
        let builder = GeoTiffBuilder::new(100, 70).bands(2).tile_size(32, 32).tiff_variant(variant);
        let builder = builder.nodata("255").pixel_scale(0.5, 0.5).origin(10.0, 20.0).projected_epsg(32617).sparse(true);
        let cog = CogBuilder::new(builder).overview_levels(vec![2, 4]);
        let mut writer = cog.tile_writer(File::create(path).unwrap()).unwrap();
        for (x, y) in (0..96).step_by(32).flat_map(|x| [(x, 0), (x, 32)]) {
            let value = |(row, column, band): (usize, usize, usize)| (x + 3 * y + 5 * row + column + 7 * band) as u8;
            writer.write_tile_3d(x, y, &ndarray::Array3::from_shape_fn((32, 32, 2), value).view()).unwrap();
        }
        writer.finish().unwrap();
    }

    /// Every image of a file, and of the first its texts.
    fn images(path: &Path) -> (Vec<Vec<u8>>, Option<String>) {
        let mut decoder = Decoder::new(File::open(path).unwrap()).unwrap();
        let text = decoder.get_tag_ascii_string(Tag::Unknown(GDAL_METADATA as u16)).ok();
        assert_eq!(decoder.get_tag_ascii_string(Tag::GdalNodata).unwrap(), "255");
        let mut images = vec![];
        loop {
            let DecodingResult::U8(image) = decoder.read_image().unwrap() else { panic!("no bytes") };
            images.push(image);
            if !decoder.more_images() {
                return (images, text);
            }
            decoder.next_image().unwrap();
        }
    }

    #[test]
    fn a_named_file_shows_the_same_images_and_the_names() {
        for variant in [TiffVariant::Classic, TiffVariant::BigTiff] {
            let path = std::env::temp_dir().join(format!("tsense-bands-{}-{variant:?}.tif", std::process::id()));
            raster(&path, variant);
            let (before, none) = images(&path);
            name_bands(&path, &BANDS).unwrap();
            let (after, text) = images(&path);
            std::fs::remove_file(&path).unwrap();
            assert!(before.len() == 3 && before == after && none.is_none());
            let text = text.unwrap();
            for item in ["0\" role=\"description\">cost<", "1\" role=\"unittype\">m<", "0\" role=\"unittype\">of 253<"]
            {
                assert!(text.contains(item), "{item} in {text}");
            }
        }
    }

    #[test]
    fn a_text_of_any_length_is_even_and_ends_with_its_only_zero() {
        for name in ["slope", "slopes"] {
            let text = metadata(&[Band { name, unit: "m" }]);
            assert!(text.len().is_multiple_of(2) && text.iter().position(|byte| *byte == 0) == Some(text.len() - 1));
        }
    }

    #[test]
    fn what_is_no_tiff_stays_as_it_is() {
        let path = std::env::temp_dir().join(format!("tsense-bands-{}.txt", std::process::id()));
        std::fs::write(&path, "MM no tiff of ours").unwrap();
        assert!(name_bands(&path, &BANDS).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"MM no tiff of ours");
        std::fs::remove_file(&path).unwrap();
    }
}
