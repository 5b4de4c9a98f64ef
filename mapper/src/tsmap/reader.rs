//! Reads a map file block by block: the header at once, one block in memory at a time.

use super::StoredBlock;
use super::fault::{TsmapFault, block_name};
use super::packing;
use super::records::{BlockHead, HEAD_BYTES, HEADER_BYTES, MapFileHeader, VERSION};
use super::{CHECKSUM_BYTES, MAGIC, PREAMBLE_BYTES, order_of};
use tsense_contract::BlockKey;

/// The blocks of a map file, in the order of the file. After the first fault it ends: what follows a damaged block
/// cannot be found. See [`Reader::check`] for a look at every block.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    header: MapFileHeader,
    blocks: usize,
    next: usize,
    at: usize,
    last: Option<BlockKey>,
    ended: bool,
}

/// What a look at one block found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlockCheck {
    /// Its position in the file, from 0.
    pub number: usize,
    /// Where it starts in the file.
    pub at: usize,
    /// Its bytes, where its end was found.
    pub bytes: Option<usize>,
    /// Which block it says it is.
    pub key: Option<BlockKey>,
    /// What is wrong with it.
    pub fault: Option<TsmapFault>,
}

impl<'a> Reader<'a> {
    /// Reads and checks the header.
    pub fn new(bytes: &'a [u8]) -> Result<Self, TsmapFault> {
        if !bytes.starts_with(&MAGIC) {
            return Err(TsmapFault::Foreign { seen: bytes[..bytes.len().min(MAGIC.len())].to_vec() });
        }
        if let Some(&[v0, v1, f0, f1]) = bytes[MAGIC.len()..].first_chunk() {
            let (seen, flags) = (u16::from_le_bytes([v0, v1]), u16::from_le_bytes([f0, f1]));
            if (seen, flags) != (VERSION, 0) {
                return Err(TsmapFault::Version { seen, flags });
            }
        }
        let preamble = part(bytes, 0, PREAMBLE_BYTES, "the header")?;
        checked(preamble, 0, "the header")?;
        let at = MAGIC.len() + 4;
        let (header, blocks) = MapFileHeader::from_bytes(&preamble[at..at + HEADER_BYTES])
            .map_err(|seen| TsmapFault::Value { at, what: "the header".into(), seen })?;
        Ok(Self { bytes, header, blocks, next: 0, at: PREAMBLE_BYTES, last: None, ended: false })
    }

    /// The header.
    pub fn header(&self) -> MapFileHeader {
        self.header
    }

    /// Looks at every block, and at the file's end. A block with a bad checksum does not hide those behind it as long
    /// as its length is believable.
    pub fn check(mut self, mut each: impl FnMut(BlockCheck, Option<StoredBlock>)) {
        while self.next < self.blocks {
            let (number, at) = (self.next, self.at);
            let head = self.head().ok();
            let bytes = head.map(|head| block_bytes(&head)).filter(|bytes| self.bytes.len() - at >= *bytes);
            let found = self.block();
            self.last = None;
            let (block, fault) = match found {
                Ok(block) => (Some(block), None),
                Err(fault) => (None, Some(fault)),
            };
            let is_lost = fault.is_some() && bytes.is_none();
            each(BlockCheck { number, at, bytes, key: head.map(|head| head.key), fault }, block);
            (self.next, self.at) = (number + 1, at + bytes.unwrap_or(0));
            if is_lost {
                return;
            }
        }
        if let Err(fault) = self.end() {
            each(BlockCheck { number: self.blocks, at: self.at, bytes: None, key: None, fault: Some(fault) }, None);
        }
    }

    fn head(&self) -> Result<BlockHead, TsmapFault> {
        let what = format!("block {}", self.next);
        let bytes = part(self.bytes, self.at, HEAD_BYTES, &what)?;
        BlockHead::from_bytes(bytes).map_err(|seen| TsmapFault::Value { at: self.at, what, seen })
    }

    /// The next block, which must be there.
    fn block(&mut self) -> Result<StoredBlock, TsmapFault> {
        let head = self.head()?;
        let what = block_name(self.next, head.key);
        let bytes = part(self.bytes, self.at, block_bytes(&head), &what)?;
        checked(bytes, self.at, &what)?;
        let value = |at: usize, seen: String| TsmapFault::Value { at, what: what.clone(), seen };
        if self.last.is_some_and(|last| order_of(last) >= order_of(head.key)) {
            return Err(value(self.at, format!("it does not come after the block before it, {:?}", self.last)));
        }
        let packed = &bytes[HEAD_BYTES..bytes.len() - CHECKSUM_BYTES];
        let block = packing::unpack(&head, packed).map_err(|seen| value(self.at + HEAD_BYTES, seen))?;
        (self.next, self.at, self.last) = (self.next + 1, self.at + bytes.len(), Some(head.key));
        Ok(block)
    }

    fn end(&self) -> Result<(), TsmapFault> {
        match self.bytes.len() - self.at {
            0 => Ok(()),
            extra => Err(TsmapFault::Trailing { at: self.at, extra }),
        }
    }
}

impl Iterator for Reader<'_> {
    type Item = Result<StoredBlock, TsmapFault>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let found = if self.next < self.blocks { Some(self.block()) } else { self.end().err().map(Err) };
        self.ended = !matches!(found, Some(Ok(_)));
        found
    }
}

fn block_bytes(head: &BlockHead) -> usize {
    HEAD_BYTES + head.packed_bytes as usize + CHECKSUM_BYTES
}

/// `length` bytes from `at` on.
fn part<'a>(bytes: &'a [u8], at: usize, length: usize, what: &str) -> Result<&'a [u8], TsmapFault> {
    let rest = &bytes[at.min(bytes.len())..];
    rest.get(..length).ok_or_else(|| TsmapFault::Truncated {
        at: bytes.len(),
        missing: length - rest.len(),
        what: what.into(),
    })
}

/// Bytes whose last four are the checksum of the others.
fn checked(bytes: &[u8], at: usize, what: &str) -> Result<(), TsmapFault> {
    let Some((content, checksum)) = bytes.split_last_chunk() else { return Ok(()) };
    let (stored, computed) = (u32::from_le_bytes(*checksum), crc32fast::hash(content));
    if stored == computed { Ok(()) } else { Err(TsmapFault::Checksum { at, what: what.into(), stored, computed }) }
}
