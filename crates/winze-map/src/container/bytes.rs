//! Where the bytes of a container are.

use std::io::{self, Read};

use memmap2::Mmap;

use super::layout::ALIGN;

/// The bytes of a whole file, from a multiple of 64 on.
#[derive(Debug)]
pub(super) enum Bytes {
    Mapped(Mmap),
    Owned(Owned),
}

impl Bytes {
    pub(super) fn as_slice(&self) -> &[u8] {
        match self {
            // Pages start at multiples of 4096 or more.
            Self::Mapped(map) => map,
            Self::Owned(owned) => owned.as_slice(),
        }
    }
}

/// Bytes on the heap, with as many unused ones in front as it takes to start at a multiple of 64.
#[derive(Debug, Default)]
pub(super) struct Owned {
    /// Never moved: neither grown nor cloned.
    heap: Vec<u8>,
    start: usize,
}

impl Owned {
    /// Reads exactly `length` bytes.
    pub(super) fn read(mut from: impl Read, length: u64) -> io::Result<Self> {
        const SPARE: usize = ALIGN as usize;
        let too_large = || io::Error::from(io::ErrorKind::OutOfMemory);
        let length = usize::try_from(length).map_err(|_| too_large())?;
        let room = length.checked_add(SPARE).ok_or_else(too_large)?;
        let mut heap = Vec::new();
        heap.try_reserve_exact(room).map_err(|_| too_large())?;
        heap.resize(room, 0);
        let start = heap.as_ptr().align_offset(SPARE);
        let target = start
            .checked_add(length)
            .and_then(|e| heap.get_mut(start..e));
        from.read_exact(target.ok_or_else(too_large)?)?;
        heap.truncate(start + length);
        Ok(Self { heap, start })
    }

    fn as_slice(&self) -> &[u8] {
        self.heap.get(self.start..).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn owned_bytes_start_at_a_multiple_of_64() {
        for length in 0..200_u8 {
            let content = vec![length; length.into()];
            let owned = Owned::read(&content[..], length.into()).unwrap();
            assert_eq!(owned.as_slice(), content);
            assert_eq!(owned.as_slice().as_ptr() as usize % 64, 0);
        }
        let short = Owned::read(&[1, 2][..], 3).unwrap_err();
        assert_eq!(short.kind(), io::ErrorKind::UnexpectedEof);
        let much = Owned::read(&[1, 2][..], u64::MAX).unwrap_err();
        assert_eq!(much.kind(), io::ErrorKind::OutOfMemory);
    }
}
