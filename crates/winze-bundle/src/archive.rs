//! Named entries in a zip archive, of which nothing is believed.

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _, Write as _};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::error::Fault;

/// Entries by name.
pub(crate) type Entries = BTreeMap<String, Vec<u8>>;

/// Bytes that all entries of an archive may unpack to.
pub(crate) const MOST_BYTES: u64 = 4 << 30;

/// Packs entries, the one of the name `first` before the others. The same entries give the same bytes.
pub(crate) fn pack(entries: &Entries, first: &str) -> Result<Vec<u8>, String> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let (head, rest): (Vec<_>, Vec<_>) = entries.iter().partition(|(name, _)| *name == first);
    for (name, content) in head.into_iter().chain(rest) {
        let options = SimpleFileOptions::DEFAULT
            .compression_method(CompressionMethod::Deflated)
            .large_file(u32::try_from(content.len()).is_err());
        writer
            .start_file(name, options)
            .map_err(|e| format!("{name}: {e}"))?;
        writer
            .write_all(content)
            .map_err(|e| format!("{name}: {e}"))?;
    }
    let packed = writer.finish().map_err(|e| e.to_string())?;
    Ok(packed.into_inner())
}

/// An archive that was opened.
pub(crate) struct Packed<'a> {
    archive: ZipArchive<Cursor<&'a [u8]>>,
    size: u64,
}

impl<'a> Packed<'a> {
    /// Looks at the archive's directory.
    pub(crate) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let archive =
            ZipArchive::new(Cursor::new(bytes)).map_err(|e| format!("no zip archive: {e}"))?;
        Ok(Self {
            archive,
            size: bytes.len() as u64,
        })
    }

    /// Bytes of the archive.
    pub(crate) fn size(&self) -> u64 {
        self.size
    }

    /// Number of entries.
    pub(crate) fn len(&self) -> usize {
        self.archive.len()
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.archive.index_for_name(name).is_some()
    }

    /// Unpacks an entry of at most so many bytes.
    pub(crate) fn entry(&mut self, name: &str, most: u64) -> Result<Vec<u8>, Fault> {
        let fault = |problem: &dyn std::fmt::Display| Fault::new(name, problem);
        let mut content = Vec::new();
        let packed = self.archive.by_name(name).map_err(|e| fault(&e))?;
        // Whatever size is declared: no more than that is unpacked.
        packed
            .take(most.saturating_add(1))
            .read_to_end(&mut content)
            .map_err(|e| fault(&format_args!("cannot be unpacked: {e}")))?;
        if content.len() as u64 > most {
            return Err(fault(&format_args!("unpacks to more than {most} bytes")));
        }
        Ok(content)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries() -> Entries {
        let named = |(name, content): (&str, &[u8])| (name.to_owned(), content.to_vec());
        [
            ("a.json", &b"{}"[..]),
            ("b/c.npy", &[7; 100_000]),
            ("z.json", b""),
        ]
        .into_iter()
        .map(named)
        .collect()
    }

    #[test]
    fn entries_come_back_and_the_bytes_are_the_same_each_time() {
        let bytes = pack(&entries(), "z.json").unwrap();
        assert_eq!(bytes, pack(&entries(), "z.json").unwrap());
        assert!(bytes.len() < 1000);
        let mut packed = Packed::open(&bytes).unwrap();
        assert_eq!(packed.len(), 3);
        for (name, content) in entries() {
            assert!(packed.has(&name));
            assert_eq!(packed.entry(&name, 100_000).unwrap(), content);
        }
        assert!(!packed.has("y.json") && packed.entry("y.json", 9).is_err());
    }

    #[test]
    fn no_more_is_unpacked_than_was_allowed() {
        let bytes = pack(&entries(), "a.json").unwrap();
        let mut packed = Packed::open(&bytes).unwrap();
        let fault = packed.entry("b/c.npy", 99_999).unwrap_err();
        assert!(fault.problem.contains("more than 99999"), "{fault:?}");
    }

    #[test]
    fn what_is_cut_is_refused() {
        let bytes = pack(&entries(), "a.json").unwrap();
        for end in 0..bytes.len() {
            assert!(Packed::open(&bytes[..end]).is_err(), "{end}");
        }
    }
}
