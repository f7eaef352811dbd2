use std::fs;
use std::io::Write;

use super::*;
use crate::Error;

/// A container in memory.
pub(super) fn made(fill: impl FnOnce(&mut ContainerWriter<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = ContainerWriter::new(&mut bytes).unwrap();
    fill(&mut writer);
    let length = writer.finish().unwrap();
    assert_eq!(length, bytes.len() as u64);
    bytes
}

const POINTS: [[f32; 3]; 5] = [[1., 2., 3.], [4., 5., 6.], [7., 8., 9.], [0.; 3], [-1.; 3]];

/// Several sections of several sizes, one of them empty, one of bytes.
pub(super) fn sample() -> Vec<u8> {
    made(|file| {
        file.section(*b"META", 0, b"{\"name\": \"mine\"}").unwrap();
        file.section(*b"PNTS", 0, &POINTS).unwrap();
        file.section::<u64>(*b"NONE", 0, &[]).unwrap();
        let fill = |section: &mut SectionWriter<'_, '_, u64>| {
            (0..8).try_for_each(|i| section.append(&[i, i * i]))
        };
        file.stream(*b"PNTS", 1, fill).unwrap();
        file.section(*b"LAST", 7, &[1.5_f64]).unwrap();
    })
}

#[test]
fn what_was_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wmap");
    fs::write(&path, sample()).unwrap();
    let opened = [
        Container::open(&path).unwrap(),
        Container::read(&path).unwrap(),
        Container::from_bytes("a", &sample()).unwrap(),
    ];
    for file in opened {
        assert_eq!(
            file.section::<u8>(*b"META", 0).unwrap(),
            b"{\"name\": \"mine\"}"
        );
        assert_eq!(file.section::<[f32; 3]>(*b"PNTS", 0).unwrap(), POINTS);
        assert!(file.section::<u64>(*b"NONE", 0).unwrap().is_empty());
        let squares: Vec<u64> = (0..8).flat_map(|i| [i, i * i]).collect();
        assert_eq!(file.section::<u64>(*b"PNTS", 1).unwrap(), squares);
        assert_eq!(file.section::<f64>(*b"LAST", 7).unwrap(), [1.5]);
        assert_eq!(file.length(), sample().len() as u64);
        file.verify_all(&mut |_, _| ()).unwrap();
        for entry in file.entries() {
            assert_eq!((entry.offset % 64, entry.intact), (0, Some(true)));
        }
        let names: Vec<String> = file.entries().map(|e| e.id.to_string()).collect();
        assert_eq!(names, ["META 0", "PNTS 0", "NONE 0", "PNTS 1", "LAST 7"]);
    }
}

#[test]
fn a_container_may_be_empty() {
    let bytes = made(|_| ());
    assert_eq!(bytes.len(), 128);
    let file = Container::from_bytes("a", &bytes).unwrap();
    assert_eq!(file.entries().len(), 0);
    file.verify_all(&mut |_, _| ()).unwrap();
}

#[test]
fn sections_are_aligned_for_any_number() {
    let bytes = made(|file| {
        for i in 0..130 {
            file.section(*b"BYTE", i, &vec![i as u8; i as usize])
                .unwrap();
            file.section(*b"WIDE", i, &[u128::from(i)]).unwrap();
        }
    });
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wmap");
    fs::write(&path, &bytes).unwrap();
    let file = Container::open(&path).unwrap();
    for i in 0..130 {
        let wide = file.section::<u128>(*b"WIDE", i).unwrap();
        assert_eq!(wide, [u128::from(i)]);
        assert_eq!(wide.as_ptr() as usize % 64, 0);
        assert_eq!(
            file.section::<u8>(*b"BYTE", i).unwrap(),
            vec![i as u8; i as usize]
        );
    }
}

#[test]
fn sections_of_bytes_can_be_written_to_like_files() {
    let bytes = made(|file| {
        file.stream(*b"TEXT", 0, |section| write!(section, "{} and {}", 1, 2))
            .unwrap();
    });
    let file = Container::from_bytes("a", &bytes).unwrap();
    assert_eq!(file.section::<u8>(*b"TEXT", 0).unwrap(), b"1 and 2");
}

#[test]
fn unknown_sections_are_listed_and_verified_but_harm_nobody() {
    let mut bytes = sample();
    let file = Container::from_bytes("a", &bytes).unwrap();
    let unknown: Vec<_> = file.unknown(&[*b"META", *b"PNTS", *b"NONE"]).collect();
    assert_eq!(unknown.len(), 1);
    assert_eq!((unknown[0].id.tag, unknown[0].intact), (*b"LAST", None));
    bytes[unknown[0].offset as usize] ^= 1;
    let file = Container::from_bytes("a", &bytes).unwrap();
    file.section::<[f32; 3]>(*b"PNTS", 0).unwrap();
    let told = file.verify_all(&mut |_, _| ()).unwrap_err().to_string();
    assert!(told.starts_with("a: section LAST 7: damaged"), "{told}");
}

#[test]
fn progress_counts_the_bytes_of_sections() {
    let file = Container::from_bytes("a", &sample()).unwrap();
    let all: u64 = file.entries().map(|e| e.length).sum();
    let mut seen = Vec::new();
    file.verify_all(&mut |done, of| seen.push((done, of)))
        .unwrap();
    assert!(seen.is_sorted() && seen.iter().all(|(_, of)| *of == all));
    assert_eq!(seen.last(), Some(&(all, all)));
}

#[test]
fn what_is_missing_or_of_another_type_is_told() {
    let file = Container::from_bytes("a", &sample()).unwrap();
    assert!(file.contains(*b"PNTS", 1) && !file.contains(*b"PNTS", 2));
    let told = file.section::<u8>(*b"PN\n\0", 2).unwrap_err().to_string();
    assert!(
        told.starts_with("a: has no section PN\\n\\x00 2; build"),
        "{told}"
    );
    let told = file.section::<f32>(*b"PNTS", 0).unwrap_err().to_string();
    let wanted = "a: section PNTS 0: elements of 12 bytes instead of 4; build the map again";
    assert!(told.starts_with(wanted), "{told}");
}

#[test]
fn a_section_cannot_be_written_twice_nor_after_a_failure() {
    let mut bytes = Vec::new();
    let mut file = ContainerWriter::new(&mut bytes).unwrap();
    file.section(*b"PNTS", 0, &[1_u8]).unwrap();
    let told = file.section(*b"PNTS", 0, &[1_u8]).unwrap_err().to_string();
    assert_eq!(told, "section PNTS 0 is written twice");
    file.section(*b"PNTS", 1, &[1_u8]).unwrap();
    let failed = |section: &mut SectionWriter<'_, '_, u8>| {
        section.append(&[1])?;
        Err(std::io::ErrorKind::StorageFull.into())
    };
    file.stream(*b"HALF", 0, failed).unwrap_err();
    file.section(*b"PNTS", 2, &[1_u8]).unwrap_err();
    file.finish().unwrap_err();
    assert!(Container::from_bytes("a", &bytes).is_err());
}

#[test]
fn a_file_is_replaced_under_those_who_read_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wmap");
    write(&path, |file| file.section(*b"PNTS", 0, &[1_u32; 5000])).unwrap();
    let old = Container::open(&path).unwrap();
    let failed = write(&path, |file| {
        file.section(*b"PNTS", 0, &[3_u32])?;
        Err(Error::ByteOrder { file: "b".into() }.into())
    });
    assert!(matches!(failed, Err(Error::ByteOrder { .. })));
    write(&path, |file| file.section(*b"PNTS", 0, &[2_u32])).unwrap();
    assert_eq!(old.section::<u32>(*b"PNTS", 0).unwrap(), [1; 5000]);
    let new = Container::open(&path).unwrap();
    assert_eq!(new.section::<u32>(*b"PNTS", 0).unwrap(), [2]);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn what_was_read_into_memory_survives_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wmap");
    write(&path, |file| file.section(*b"PNTS", 0, &[1_u32; 5000])).unwrap();
    let file = Container::read(&path).unwrap();
    fs::write(&path, "").unwrap();
    assert_eq!(file.section::<u32>(*b"PNTS", 0).unwrap(), [1; 5000]);
}

#[test]
fn threads_may_ask_for_the_same_section() {
    fn shared<T: Send + Sync>() {}
    shared::<Container>();
    let bytes = made(|file| file.section(*b"PNTS", 0, &vec![1_u8; 9 << 20]).unwrap());
    let file = Container::from_bytes("a", &bytes).unwrap();
    use rayon::prelude::*;
    (0..64).into_par_iter().for_each(|_| {
        assert_eq!(file.section::<u8>(*b"PNTS", 0).unwrap().len(), 9 << 20);
    });
}

#[test]
fn files_that_are_no_maps_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wmap");
    let cases: [(&[u8], &str); 6] = [
        (b"", "is no prepared map (it is empty)"),
        (
            b"# .PCD v0.7 - Point Cloud Data\nVERSION 0.7\n",
            "in the PCD format",
        ),
        (b"ply\nformat ascii 1.0\n", "in the PLY format"),
        (&[0; 500], "it does not begin as one does"),
        (b"1 2 3\n4 5 6\n", "it does not begin as one does"),
        (b"WINZE", "ends within its header"),
    ];
    for (bytes, wanted) in cases {
        fs::write(&path, bytes).unwrap();
        for opened in [Container::open(&path), Container::read(&path)] {
            let told = opened.unwrap_err().to_string();
            assert!(told.contains(wanted), "{told}");
            assert!(told.ends_with("`winze map build`"), "{told}");
        }
    }
    let told = Container::open(folder.path()).unwrap_err().to_string();
    assert!(told.ends_with("is a folder; name a file"), "{told}");
    let told = Container::open(&folder.path().join("no")).unwrap_err();
    assert!(told.to_string().ends_with("no such file; check the path"));
    if cfg!(unix) {
        let told = Container::open("/dev/null".as_ref()).unwrap_err();
        assert!(told.to_string().contains("no regular file"), "{told}");
    }
}

/// What the docs say of a file that is cut short while it is mapped.
#[cfg(target_os = "linux")]
#[test]
fn a_file_cut_short_while_mapped_kills_with_sigbus() {
    use std::os::unix::process::ExitStatusExt;
    if let Some(path) = std::env::var_os("WINZE_MAP_CUT") {
        let file = Container::open(path.as_ref()).unwrap();
        fs::write(&path, "").unwrap();
        let _ = file.section::<u32>(*b"PNTS", 0);
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wmap");
    write(&path, |file| file.section(*b"PNTS", 0, &[1_u32; 5000])).unwrap();
    let this = std::env::current_exe().unwrap();
    let name = "container::tests::a_file_cut_short_while_mapped_kills_with_sigbus";
    let killed = std::process::Command::new(this)
        .args(["--exact", name, "--nocapture"])
        .env("WINZE_MAP_CUT", &path)
        .output()
        .unwrap();
    assert_eq!(killed.status.signal(), Some(7));
}
