//! Checksums of long sections.

use crc32fast::Hasher;
use rayon::prelude::*;

/// One thread's share: long enough that handing it out costs nothing.
const PART: usize = 4 << 20;
/// Progress is told this often.
const BLOCK: usize = 64 << 20;

/// The CRC-32 of `bytes`; `progress` gets the number of bytes done since its last call.
pub(super) fn crc(bytes: &[u8], progress: &mut dyn FnMut(u64)) -> u32 {
    let mut all = Hasher::new();
    for block in bytes.chunks(BLOCK) {
        let parts: Vec<Hasher> = block
            .par_chunks(PART)
            .map(|part| {
                let mut hasher = Hasher::new();
                hasher.update(part);
                hasher
            })
            .collect();
        parts.iter().for_each(|part| all.combine(part));
        progress(block.len() as u64);
    }
    all.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_parts_it_is_the_same() {
        let bytes: Vec<u8> = (0..BLOCK + 2 * PART + 17)
            .map(|i| ((i * i) >> 7) as u8)
            .collect();
        for length in [0, 1, PART, PART + 1, bytes.len()] {
            let mut done = 0;
            let crc = crc(&bytes[..length], &mut |more| done += more);
            assert_eq!(crc, crc32fast::hash(&bytes[..length]));
            assert_eq!(done, length as u64);
        }
    }
}
