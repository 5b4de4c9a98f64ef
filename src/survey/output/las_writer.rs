//! A LAS or LAZ file on its way to the disk.
//!
//! The library's writer ends its file where it is dropped, and panics where that fails: on a full disk. So it is dropped
//! only when it has been closed; one that failed is left to the end of the process.

use las::{Header, Writer};
use std::fs::File;
use std::io::BufWriter;
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};

/// The library's writer, without its panic.
pub struct LasWriter(ManuallyDrop<Writer<BufWriter<File>>>);

impl LasWriter {
    /// Writes the header.
    pub fn new(file: File, header: Header) -> Result<Self, las::Error> {
        Writer::new(BufWriter::new(file), header).map(|writer| Self(ManuallyDrop::new(writer)))
    }

    /// Ends the file.
    pub fn close(mut self) -> Result<(), las::Error> {
        self.0.close()?;
        drop(ManuallyDrop::into_inner(self.0));
        Ok(())
    }
}

impl Deref for LasWriter {
    type Target = Writer<BufWriter<File>>;
    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl DerefMut for LasWriter {
    fn deref_mut(&mut self) -> &mut Self::Target {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_full_disk_is_an_error_whether_the_file_is_closed_or_given_up() {
        let full = Path::new("/dev/full");
        for is_compressed in [false, true] {
            for is_closed in [false, true] {
                let mut builder = las::Builder::from((1, 4));
                builder.point_format.is_compressed = is_compressed;
                let mut writer = LasWriter::new(File::create(full).unwrap(), builder.into_header().unwrap()).unwrap();
                let written = (0..100_000).try_for_each(|_| writer.write_point(las::Point::default()));
                let failed = if is_closed { writer.close().is_err() } else { written.is_err() || is_compressed };
                assert!(failed, "compressed {is_compressed}, closed {is_closed}");
            }
        }
    }
}
