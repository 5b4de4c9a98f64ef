//! One datagram of AS5669A: a version byte, then messages back to back, each with a header and a sequence number.
//!
//! In: bytes. Out: [`Packet`]s, or why the datagram is none. It keeps no state and follows no protocol.

use crate::bytes::{Malformed, Reader, Writer};
use crate::id::Id;

/// The UDP port that IANA knows as `jaus`.
pub const PORT: u16 = 3794;
/// The multicast group in which a component whose address is unknown is looked for.
pub const GROUP: std::net::Ipv4Addr = std::net::Ipv4Addr::new(239, 255, 0, 1);
/// Most body bytes in one packet; longer bodies are split.
pub const BODY_MAX: usize = 4079;
/// Bytes around the body.
const OVERHEAD: usize = 14;
/// The version of this transport, first byte of each datagram.
const VERSION: u8 = 2;

macro_rules! flags {
    ($($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $value:literal,)+ })+) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub enum $name { $($(#[$variant_doc])* $variant,)+ }

        impl $name {
            fn from_bits(bits: u8) -> Option<Self> {
                match bits & 3 { $($value => Some(Self::$variant),)+ _ => None }
            }
            fn to_bits(self) -> u8 {
                match self { $(Self::$variant => $value,)+ }
            }
        }
    )+};
}

flags! {
    /// How urgent a packet is.
    Priority {
        /// Low.
        Low = 0,
        /// Standard.
        #[default] Standard = 1,
        /// High.
        High = 2,
        /// Safety critical.
        Safety = 3,
    }
    /// Whom a packet is broadcast to.
    Broadcast {
        /// Nobody: it has one receiver.
        #[default] None = 0,
        /// The subsystem.
        Local = 1,
        /// The system.
        Global = 2,
    }
    /// The acknowledgement a packet asks for, or is.
    Ack {
        /// None.
        #[default] None = 0,
        /// It asks for one.
        Wanted = 1,
        /// It says that a packet did not arrive well.
        Negative = 2,
        /// It is one.
        Positive = 3,
    }
    /// Which part of a message a packet is.
    Part {
        /// All of it.
        #[default] Whole = 0,
        /// The first.
        First = 1,
        /// Neither first nor last.
        Middle = 2,
        /// The last.
        Last = 3,
    }
}

/// One message, or a part of one, as it travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packet<'a> {
    /// How urgent.
    pub priority: Priority,
    /// Whom it is broadcast to.
    pub broadcast: Broadcast,
    /// Acknowledgement.
    pub ack: Ack,
    /// Which part.
    pub part: Part,
    /// To whom.
    pub destination: Id,
    /// From whom.
    pub source: Id,
    /// Message code and fields, or a part of them.
    pub body: &'a [u8],
    /// Rises by one with each packet of a source.
    pub sequence: u16,
}

/// Why a datagram is not one of this transport.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It has no byte.
    Empty,
    /// It is of AS5669 without the A, or of the older OPC and RA stacks.
    OlderPeer,
    /// It begins with no version known.
    Version,
    /// A message in it is cut short, or says so.
    Size,
    /// Its header is compressed, or it is of a reserved type.
    Unsupported,
    /// Bits that mean nothing.
    Flags,
}

impl Fault {
    /// In a few words, as a cause to count by.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Empty => "empty datagram",
            Self::OlderPeer => "unsupported older peer",
            Self::Version => "not jaus",
            Self::Size => "datagram cut short",
            Self::Unsupported => "compressed or reserved header",
            Self::Flags => "impossible header",
        }
    }
}

/// The packets of a datagram, or why it is of no use. A datagram is taken whole or not at all.
pub fn parse(datagram: &[u8]) -> Result<Vec<Packet<'_>>, Fault> {
    let (version, mut rest) = datagram.split_first().ok_or(Fault::Empty)?;
    if *version == 1 || datagram.starts_with(b"JAUS01.0") {
        return Err(Fault::OlderPeer);
    }
    if *version != VERSION {
        return Err(Fault::Version);
    }
    if rest.is_empty() {
        return Err(Fault::Size);
    }
    let mut packets = Vec::new();
    while !rest.is_empty() {
        let size = rest.get(1..3).map_or(0, |size| usize::from(u16::from_le_bytes([size[0], size[1]])));
        if size < OVERHEAD || size > rest.len() {
            return Err(Fault::Size);
        }
        let (message, behind) = rest.split_at(size);
        packets.push(parse_message(message)?);
        rest = behind;
    }
    Ok(packets)
}

fn parse_message(message: &[u8]) -> Result<Packet<'_>, Fault> {
    let (head, tail) = message.split_at(message.len() - 2);
    let cut = |_: Malformed| Fault::Size;
    let mut reader = Reader::new(head);
    if reader.u8().map_err(cut)? != 0 {
        return Err(Fault::Unsupported);
    }
    reader.u16().map_err(cut)?;
    let flags = reader.u8().map_err(cut)?;
    let destination = Id::from_wire(reader.u32().map_err(cut)?);
    let source = Id::from_wire(reader.u32().map_err(cut)?);
    Ok(Packet {
        priority: Priority::from_bits(flags).ok_or(Fault::Flags)?,
        broadcast: Broadcast::from_bits(flags >> 2).ok_or(Fault::Flags)?,
        ack: Ack::from_bits(flags >> 4).ok_or(Fault::Flags)?,
        part: Part::from_bits(flags >> 6).ok_or(Fault::Flags)?,
        destination,
        source,
        body: reader.rest(),
        sequence: u16::from_le_bytes([tail[0], tail[1]]),
    })
}

impl Packet<'_> {
    /// A datagram of this packet alone. The body is at most [`BODY_MAX`] bytes.
    pub fn datagram(&self) -> Vec<u8> {
        let mut out = Writer::default();
        out.u8(VERSION);
        out.u8(0);
        out.u16((self.body.len() + OVERHEAD) as u16);
        let [priority, broadcast] = [self.priority.to_bits(), self.broadcast.to_bits()];
        out.u8(priority | broadcast << 2 | self.ack.to_bits() << 4 | self.part.to_bits() << 6);
        out.u32(self.destination.to_wire());
        out.u32(self.source.to_wire());
        out.bytes(self.body);
        out.u16(self.sequence);
        out.into_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packet(body: &[u8]) -> Packet<'_> {
        Packet {
            priority: Priority::Standard,
            broadcast: Broadcast::Global,
            ack: Ack::Wanted,
            part: Part::Whole,
            destination: Id::new(126, 1, 10),
            source: Id::new(126, 1, 20),
            body,
            sequence: 1,
        }
    }

    #[test]
    fn the_first_datagram_of_the_capture_is_written_byte_for_byte() {
        // Request Control with authority 200, broadcast, acknowledgement wanted.
        let bytes = packet(&[0x0d, 0x00, 200]).datagram();
        let golden = [2, 0, 0x11, 0, 0x19, 0x0a, 1, 0x7e, 0, 0x14, 1, 0x7e, 0, 0x0d, 0, 200, 1, 0];
        assert_eq!(bytes, golden);
        assert_eq!(parse(&bytes).unwrap(), [packet(&[0x0d, 0x00, 200])]);
    }

    #[test]
    fn several_messages_share_a_datagram() {
        let one = packet(&[1, 2, 3]).datagram();
        let two = packet(&[]).datagram();
        let both = [&one[..], &two[1..]].concat();
        let parsed = parse(&both).unwrap();
        assert_eq!((parsed.len(), parsed[0].body.len(), parsed[1].body.len()), (2, 3, 0));
    }

    #[test]
    fn what_is_cut_at_any_byte_is_refused_whole() {
        let one = packet(&[1, 2, 3]).datagram();
        let both = [&one[..], &one[1..]].concat();
        let mut refused = 0;
        for end in 0..both.len() {
            let parsed = parse(&both[..end]);
            assert_eq!(parsed.is_ok(), end == one.len(), "cut at {end}");
            refused += usize::from(parsed.is_err());
        }
        assert_eq!(refused, both.len() - 1);
    }

    #[test]
    fn faults_are_told_apart() {
        let good = packet(&[1, 2]).datagram();
        let with = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            parse(&bytes).unwrap_err()
        };
        assert_eq!(with(0, 1), Fault::OlderPeer);
        assert_eq!(parse(b"JAUS01.0........"), Err(Fault::OlderPeer));
        assert_eq!(with(0, 7), Fault::Version);
        assert_eq!(with(1, 0x40), Fault::Unsupported);
        assert_eq!(with(1, 1), Fault::Unsupported);
        assert_eq!(with(4, 0x0c), Fault::Flags);
        assert_eq!(with(2, 13), Fault::Size);
        assert_eq!(parse(&[]), Err(Fault::Empty));
    }
}
