//! Ten thousand damaged maps: each is refused or answers exactly as the whole one, and none brings the program down.
//!
//! `WINZE_DAMAGED` sets another number of them.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use common::damage::{Damage, Damaged, damaged};
use common::{cheap, query, small_map};
use rayon::prelude::*;
use winze::locate::locate_in;
use winze::{KeptMap, KeptQuery, Request};
use winze_map::{Map, Result};

/// What a map answers, but for times; `check`ed before, or not.
fn answer(bytes: &[u8], query: &mut KeptQuery<'_>, checked: bool) -> Result<String> {
    let map = Map::from_bytes("damaged.wmap", bytes)?;
    if checked {
        map.check(&mut |_, _| ())?;
    }
    let config = map.adopt(&cheap())?;
    let mut kept = KeptMap::prepared(&map);
    let mut outcome = locate_in(&mut kept, query, &config, &Request::default())?;
    (outcome.seconds, outcome.map_seconds) = (0.0, 0.0);
    outcome.stages.clear();
    Ok(format!("{outcome:?}"))
}

fn printable(error: &winze_map::Error, what: &str) {
    let told = error.to_string();
    assert!(!told.chars().any(char::is_control), "{what}: {told:?}");
    assert!(told.len() < 1000, "{what}: {told}");
}

#[derive(Debug, Default)]
struct Tally {
    refused_on_opening: AtomicUsize,
    refused_on_checking: AtomicUsize,
    refused_on_locating: AtomicUsize,
    answered_alike: AtomicUsize,
    forged_and_answered: AtomicUsize,
}

#[test]
fn damaged_maps_are_refused_or_answer_as_the_whole_one() {
    let many = std::env::var("WINZE_DAMAGED").map_or(10_000, |n| n.parse().unwrap());
    let (_folder, _, sound) = small_map();
    let cloud = query();
    let whole = answer(&sound, &mut KeptQuery::new(&cloud), true).unwrap();
    assert!(whole.contains("verdict: Located"), "{whole}");
    let tally = Tally::default();
    let longest = (0..many)
        .into_par_iter()
        .map_init(
            || KeptQuery::new(&cloud),
            |query, number| {
                let begun = Instant::now();
                let made = damaged(&sound, number);
                let outcome = catch_unwind(AssertUnwindSafe(|| {
                    meet(&made, &sound, &whole, query, number, &tally);
                }));
                assert!(outcome.is_ok(), "panicked at {}", made.what);
                (begun.elapsed(), made.what)
            },
        )
        .max_by_key(|(time, _)| *time);
    println!("{} bytes, {tally:?}, longest {longest:?}", sound.len());
    let (time, what) = longest.unwrap();
    assert!(time < Duration::from_secs(60), "{time:?} for {what}");
}

fn meet(
    made: &Damaged,
    sound: &[u8],
    whole: &str,
    query: &mut KeptQuery<'_>,
    number: u64,
    tally: &Tally,
) {
    let what = &made.what;
    let map = match Map::from_bytes("damaged.wmap", &made.bytes) {
        Ok(map) => map,
        Err(e) => {
            assert!(made.bytes != sound, "{what}: {e}");
            printable(&e, what);
            tally.refused_on_opening.fetch_add(1, Relaxed);
            return;
        }
    };
    let checked = map.check(&mut |_, _| ());
    if let Err(e) = &checked {
        printable(e, what);
        tally.refused_on_checking.fetch_add(1, Relaxed);
    }
    if made.damage == Damage::Forged {
        // Nobody can tell, so it may answer anything, or find on its way that it cannot.
        if checked.is_ok() {
            match answer(&made.bytes, query, false) {
                Ok(_) => tally.forged_and_answered.fetch_add(1, Relaxed),
                Err(_) => tally.refused_on_locating.fetch_add(1, Relaxed),
            };
        }
        return;
    }
    assert_eq!(checked.is_ok(), made.bytes == sound, "{what}");
    // Whoever does not check it first meets the damage when its section is used, or never.
    if number.is_multiple_of(4) {
        match answer(&made.bytes, query, false) {
            Ok(found) => {
                assert_eq!(found, whole, "{what}");
                tally.answered_alike.fetch_add(1, Relaxed);
            }
            Err(e) => {
                printable(&e, what);
                tally.refused_on_locating.fetch_add(1, Relaxed);
            }
        }
    }
}
