//! Any bytes opened as an incident bundle; and a small sound bundle with its entries changed and all digests set right.

#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| match bytes.strip_prefix(b"patch") {
    Some(patches) => winze_fuzz::bundle::check_patched(patches),
    None => winze_fuzz::bundle::check(bytes),
});
