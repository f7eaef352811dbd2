//! What opening and checking a damaged map takes of memory: no more than the file's size, and a little.
//!
//! `WINZE_DAMAGED` sets another number of files.
#![allow(unsafe_code)]
#![allow(clippy::unwrap_used, reason = "a test")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use winze_map::Map;

/// Counts the bytes that are in use, and the most that ever were.
struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

fn more(bytes: usize) {
    let now = LIVE.fetch_add(bytes, Relaxed) + bytes;
    PEAK.fetch_max(now, Relaxed);
}

// SAFETY: all is left to the system's allocator; counting neither allocates nor changes what it answers.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        more(layout.size());
        // SAFETY: the caller keeps the promises that `System` asks for, here and below.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(at, layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        more(layout.size());
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // Both may be there for a while.
        more(size);
        // SAFETY: as above.
        let moved = unsafe { System.realloc(at, layout, size) };
        LIVE.fetch_sub(layout.size(), Relaxed);
        moved
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// On top of the file's size, see `docs/map-format.md`.
const SLACK: usize = 1 << 20;

#[test]
fn no_damaged_map_takes_more_memory_than_its_size() {
    let many = std::env::var("WINZE_DAMAGED").map_or(10_000, |n| n.parse().unwrap());
    let (folder, sound_at, sound) = common::small_map();
    let at = folder.path().join("damaged.wmap");
    let taken = |path: &std::path::Path| {
        let before = LIVE.load(Relaxed);
        PEAK.store(before, Relaxed);
        let outcome = Map::open(path).and_then(|map| map.check(&mut |_, _| ()));
        let told = outcome.map_err(|e| e.to_string());
        (PEAK.load(Relaxed) - before, told)
    };
    // The first time, threads are started.
    let _ = taken(&sound_at);
    let (whole, told) = taken(&sound_at);
    assert_eq!(told, Ok(()));
    let mut most = (0, String::new());
    for number in 0..many {
        let made = common::damage::damaged(&sound, number);
        // A new file each time, as one that is mapped must not change.
        std::fs::write(&at, &made.bytes).unwrap();
        let (bytes, told) = taken(&at);
        std::fs::remove_file(&at).unwrap();
        let size = made.bytes.len();
        assert!(
            bytes <= size + SLACK,
            "{}: {bytes} bytes for a file of {size}: {told:?}",
            made.what
        );
        if bytes > most.0 {
            most = (bytes, format!("{}, a file of {size}", made.what));
        }
    }
    println!(
        "{} bytes for the whole file of {}; at most {most:?}",
        whole,
        sound.len()
    );
}
