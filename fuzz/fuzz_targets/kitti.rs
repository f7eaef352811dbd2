//! Any bytes read as a file of KITTI.

#![no_main]

use libfuzzer_sys::fuzz_target;
use winze_io::Format;

fuzz_target!(|bytes: &[u8]| winze_fuzz::check(bytes, Format::Kitti));
