//! Any bytes read as a mesh in PLY.

#![no_main]

use libfuzzer_sys::fuzz_target;
use winze_sim::mesh_file::MeshFormat;

fuzz_target!(|bytes: &[u8]| winze_fuzz::check_mesh(bytes, MeshFormat::Ply));
