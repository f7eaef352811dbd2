//! Any bytes opened as a prepared map; and a small sound map with its sections changed and all checksums set right.

#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match bytes.strip_prefix(b"patch") {
    Some(patches) => winze_fuzz::map::check_patched(patches),
    None => winze_fuzz::map::check(bytes),
});
