//! The MCAP container, read so that damage costs as little as possible (<https://mcap.dev/spec>).
//!
//! The `mcap` crate's readers stop at the first damage and do not say where; this one reads on after a damaged chunk,
//! uses the complete messages of a chunk that was cut short, and tells the byte position of a break.

use std::collections::BTreeMap;
use std::io::{self, Read};

const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// A message as the file holds it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RawMessage<'a> {
    pub(crate) channel: u16,
    pub(crate) sequence: u32,
    pub(crate) log_time: u64,
    pub(crate) data: &'a [u8],
}

/// A channel as the file declares it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ChannelRecord {
    pub(crate) id: u16,
    pub(crate) topic: String,
    pub(crate) encoding: String,
}

/// One thing found while walking through the file.
#[derive(Debug, PartialEq)]
pub(crate) enum Item<'a> {
    Channel(ChannelRecord),
    Message(RawMessage<'a>),
    Metadata(String, BTreeMap<String, String>),
    /// Something was skipped; the reason, with byte position.
    Damaged(String),
}

/// How the file ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// With its footer.
    Whole,
    /// In the middle; at this byte the last readable record ended.
    Cut(u64),
    /// It is no MCAP file at all.
    NotMcap,
}

/// Walks through an MCAP file from front to end. Errors are the system's only.
pub(crate) fn walk(mut from: impl Read, visit: &mut dyn FnMut(Item<'_>)) -> io::Result<End> {
    let mut magic = Vec::with_capacity(8);
    from.by_ref().take(8).read_to_end(&mut magic)?;
    if magic != MAGIC {
        return Ok(End::NotMcap);
    }
    let mut position = 8u64;
    let mut body = Vec::new();
    loop {
        let mut head = [0u8; 9];
        if read_full(&mut from, &mut head)? < head.len() {
            return Ok(End::Cut(position));
        }
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length);
        body.clear();
        // Grows with what is there, so a damaged length cannot ask for more memory than the file has bytes.
        from.by_ref().take(length).read_to_end(&mut body)?;
        if (body.len() as u64) < length {
            if opcode == opcodes::CHUNK {
                chunk(&body, position, visit);
            }
            return Ok(End::Cut(position));
        }
        match opcode {
            opcodes::CHUNK => chunk(&body, position, visit),
            opcodes::FOOTER => return Ok(End::Whole),
            _ => record(opcode, &body, position, visit),
        }
        position += 9 + length;
    }
}

fn read_full(from: &mut impl Read, into: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < into.len() {
        match from.read(&mut into[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}

mod opcodes {
    pub(super) const FOOTER: u8 = 0x02;
    pub(super) const CHANNEL: u8 = 0x04;
    pub(super) const MESSAGE: u8 = 0x05;
    pub(super) const CHUNK: u8 = 0x06;
    pub(super) const METADATA: u8 = 0x0c;
}

fn record(opcode: u8, body: &[u8], position: u64, visit: &mut dyn FnMut(Item<'_>)) {
    let mut bytes = Bytes(body);
    let item = match opcode {
        opcodes::CHANNEL => bytes.channel().map(Item::Channel),
        opcodes::MESSAGE => bytes.message().map(Item::Message),
        opcodes::METADATA => bytes.metadata().map(|(name, map)| Item::Metadata(name, map)),
        // Schemas, indexes, statistics, attachments and what later versions add: not needed to read a run.
        _ => return,
    };
    visit(item.unwrap_or_else(|| {
        Item::Damaged(format!(
            "byte {position}: a record (kind 0x{opcode:02x}, {} bytes) is damaged: skipped",
            body.len()
        ))
    }));
}

fn chunk(body: &[u8], position: u64, visit: &mut dyn FnMut(Item<'_>)) {
    let mut bytes = Bytes(body);
    let Some(head) = bytes.chunk_head() else {
        visit(Item::Damaged(format!(
            "byte {position}: the head of a chunk is damaged: chunk skipped"
        )));
        return;
    };
    let between = format!(
        "between {:.3} s and {:.3} s",
        head.first_time as f64 * 1e-9,
        head.last_time as f64 * 1e-9
    );
    if !head.compression.is_empty() {
        visit(Item::Damaged(format!(
            "byte {position}: what was recorded {between} is compressed ({}), which this program does not read: skipped; \
             uncompress the file first (mcap compress --compression none)",
            head.compression
        )));
        return;
    }
    let records = bytes.0;
    let complete = records.len() as u64 == head.size;
    if complete && head.crc != 0 && crc32fast::hash(records) != head.crc {
        visit(Item::Damaged(format!(
            "byte {position}: a chunk of {} bytes is damaged (its checksum does not fit): what was recorded {between} is lost",
            head.size
        )));
        return;
    }
    let mut rest = Bytes(records);
    let inside = position + 9 + (body.len() - records.len()) as u64;
    loop {
        let at = inside + (records.len() - rest.0.len()) as u64;
        let (Some(opcode), Some(length)) = (rest.u8(), rest.u64()) else {
            return;
        };
        let Some(body) = usize::try_from(length).ok().and_then(|length| rest.take(length)) else {
            return;
        };
        record(opcode, body, at, visit);
    }
}

struct ChunkHead {
    first_time: u64,
    last_time: u64,
    size: u64,
    crc: u32,
    compression: String,
}

/// Reads little-endian values from the front; `None` when there are too few bytes.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (front, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(front)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn string(&mut self) -> Option<String> {
        let length = self.u32()? as usize;
        String::from_utf8(self.take(length)?.to_vec()).ok()
    }

    fn map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = self.u32()? as usize;
        let mut inside = Bytes(self.take(length)?);
        let mut map = BTreeMap::new();
        while !inside.0.is_empty() {
            map.insert(inside.string()?, inside.string()?);
        }
        Some(map)
    }

    fn channel(&mut self) -> Option<ChannelRecord> {
        let id = self.u16()?;
        let _schema = self.u16()?;
        Some(ChannelRecord {
            id,
            topic: self.string()?,
            encoding: self.string()?,
        })
    }

    fn message(&mut self) -> Option<RawMessage<'a>> {
        let channel = self.u16()?;
        let sequence = self.u32()?;
        let log_time = self.u64()?;
        let _publish_time = self.u64()?;
        Some(RawMessage {
            channel,
            sequence,
            log_time,
            data: self.0,
        })
    }

    fn metadata(&mut self) -> Option<(String, BTreeMap<String, String>)> {
        Some((self.string()?, self.map()?))
    }

    fn chunk_head(&mut self) -> Option<ChunkHead> {
        let head = ChunkHead {
            first_time: self.u64()?,
            last_time: self.u64()?,
            size: self.u64()?,
            crc: self.u32()?,
            compression: self.string()?,
        };
        let _compressed_size = self.u64()?;
        Some(head)
    }
}
