//! LZF, the compression of PCD's `binary_compressed`.
//!
//! A stream of blocks, each led by a control byte `c`:
//! * `c < 32`: the next `c + 1` bytes are literal;
//! * else a match: length `(c >> 5) + 2`, where a `c >> 5` of 7 adds the next byte; distance
//!   `((c & 31) << 8 | next byte) + 1`, counted back from the end of the output.
//!
//! The format is Marc Lehmann's; this is an implementation of its description.

use std::io::{self, Read, Write};

/// The longest match, 7 + 255 + 2 bytes, takes three bytes of input.
const LONGEST_MATCH: usize = 264;

/// No stream can grow by more than this: 88 times. A claim below it may be true, so this is also how
/// much a hostile file can make a reader unpack for each of its bytes.
pub(crate) const MOST_EXPANSION: usize = LONGEST_MATCH / 3;

const FURTHEST: usize = 1 << 13;
const LONGEST_LITERAL: usize = 32;
const HASH_BITS: u32 = 15;

/// The decompressed bytes, which must number exactly `size`.
///
/// `size` is allocated up front: check it against [`MOST_EXPANSION`] first.
///
/// # Errors
/// The position in `input` of the block that is broken, that is cut short or that overshoots.
pub(crate) fn decompress(input: &[u8], size: usize) -> Result<Vec<u8>, usize> {
    let mut out = vec![0; size];
    let (_, at) = blocks(input, &mut out, 0, [0, 0])?;
    if at == size {
        Ok(out)
    } else {
        Err(input.len())
    }
}

/// The longest block: its control byte and a literal.
const LONGEST_BLOCK: usize = 1 + LONGEST_LITERAL;

/// The bytes that [`unpack`] holds of its input, and of its output beside what matches reach.
const WINDOW: usize = 1 << 18;

/// Like [`decompress`], in bounded memory: the first `packed` bytes of `input` become the `size`
/// bytes that are written to `out`.
///
/// # Errors
/// As [`decompress`] within, else where `input` or `out` fail.
pub(crate) fn unpack(
    input: &mut impl Read,
    packed: u64,
    size: u64,
    out: &mut impl Write,
) -> io::Result<Result<(), u64>> {
    // Neither buffer is longer than the data.
    let fits = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
    let mut source = Vec::new();
    let mut passed = 0u64;
    let mut window = vec![0; fits(size).min(FURTHEST + WINDOW)];
    let (mut at, mut written) = (0usize, 0u64);
    // The output's bytes that are in the window before `at` and already written.
    let mut kept = 0usize;
    loop {
        let wanted = WINDOW - source.len().min(WINDOW);
        let there = passed + source.len() as u64;
        let more = fits(packed - there).min(wanted);
        let held = source.len();
        source.resize(held + more, 0);
        input.read_exact(source.get_mut(held..).unwrap_or_default())?;
        let last_input = passed + source.len() as u64 == packed;
        let left = fits(size - written);
        let end = window.len().min(kept.saturating_add(left));
        let last_output = end - kept == left;
        let spare = [
            if last_input { 0 } else { LONGEST_BLOCK },
            if last_output { 0 } else { LONGEST_MATCH },
        ];
        let room = window.get_mut(..end).unwrap_or_default();
        let (read, now) = match blocks(&source, room, at, spare) {
            Ok(moved) => moved,
            Err(block) => return Ok(Err(passed + block as u64)),
        };
        out.write_all(window.get(kept..now).unwrap_or_default())?;
        written += (now - kept) as u64;
        passed += read as u64;
        source.drain(..read);
        if passed == packed {
            return Ok(if written == size { Ok(()) } else { Err(packed) });
        }
        at = now.min(FURTHEST);
        window.copy_within(now - at..now, 0);
        kept = at;
    }
}

/// Decompresses blocks of `input` into `out` from `at` on, as long as more than `spare[0]` bytes of
/// input are left and at least `spare[1]` bytes of room. Returns the bytes read and the new `at`.
fn blocks(
    input: &[u8],
    out: &mut [u8],
    mut at: usize,
    spare: [usize; 2],
) -> Result<(usize, usize), usize> {
    let mut rest = input;
    while rest.len() > spare[0] && out.len() >= at + spare[1] {
        (rest, at) = easy_blocks(rest, out, at);
        if rest.len() <= spare[0] || out.len() < at + spare[1] {
            break;
        }
        let Some((&control, tail)) = rest.split_first() else {
            break;
        };
        let block = input.len() - rest.len();
        let control = usize::from(control);
        let length;
        if control < LONGEST_LITERAL {
            length = control + 1;
            copy_literal(out, at, tail, length).ok_or(block)?;
            rest = tail.get(length..).ok_or(block)?;
        } else {
            let (extra, tail) = match control >> 5 {
                7 => tail
                    .split_first()
                    .map(|(&n, tail)| (usize::from(n), tail))
                    .ok_or(block)?,
                _ => (0, tail),
            };
            let (&low, tail) = tail.split_first().ok_or(block)?;
            length = (control >> 5) + extra + 2;
            let distance = ((control & 31) << 8 | usize::from(low)) + 1;
            copy_match(out, at, distance, length).ok_or(block)?;
            rest = tail;
        }
        at += length;
    }
    Ok((input.len() - rest.len(), at))
}

/// Matches are copied so many bytes at a time.
const STEP: usize = 8;

/// Decompresses blocks as long as they need no care: far from both ends, and without a match that runs into its own
/// output within a step. Returns what is left of the input and the new `at`; what comes next may be anything.
fn easy_blocks<'a>(input: &'a [u8], out: &mut [u8], mut at: usize) -> (&'a [u8], usize) {
    let mut rest = input;
    while let Some(head) = rest.first_chunk::<LONGEST_BLOCK>() {
        if out.len() < at + LONGEST_MATCH + LONGEST_LITERAL {
            break;
        }
        let [control, literal @ ..] = head;
        let control = usize::from(*control);
        let (read, length);
        if control < LONGEST_LITERAL {
            length = control + 1;
            read = length + 1;
            let Some(to) = out.get_mut(at..).and_then(|out| out.first_chunk_mut()) else {
                break;
            };
            *to = *literal;
        } else {
            let [first, second, ..] = *literal;
            let (first, second) = (usize::from(first), usize::from(second));
            let long = control >> 5 == 7;
            let (extra, low) = if long { (first, second) } else { (0, first) };
            length = (control >> 5) + extra + 2;
            read = 2 + usize::from(long);
            let distance = ((control & 31) << 8 | low) + 1;
            if distance < STEP || distance > at {
                break;
            }
            let mut to = at;
            while to < at + length {
                let step = out
                    .get(to - distance..)
                    .and_then(|out| out.first_chunk::<STEP>());
                let Some(step) = step.copied() else { break };
                let Some(place) = out.get_mut(to..).and_then(|out| out.first_chunk_mut()) else {
                    break;
                };
                *place = step;
                to += STEP;
            }
        }
        at += length;
        rest = rest.get(read..).unwrap_or_default();
    }
    (rest, at)
}

/// Puts the first `length` bytes of `input` at `at`. `None` where there is no such place.
fn copy_literal(out: &mut [u8], at: usize, input: &[u8], length: usize) -> Option<()> {
    let out = out.get_mut(at..).filter(|out| out.len() >= length)?;
    // A copy of fixed length is much faster; later blocks put right what it writes too much.
    if let (Some(to), Some(from)) = (
        out.first_chunk_mut(),
        input.first_chunk::<LONGEST_LITERAL>(),
    ) {
        *to = *from;
    } else {
        out.get_mut(..length)?.copy_from_slice(input.get(..length)?);
    }
    Some(())
}

/// Repeats `length` bytes from `distance` before `at` on; a match may run into its own output.
/// `None` where there is no such place.
fn copy_match(out: &mut [u8], at: usize, distance: usize, length: usize) -> Option<()> {
    let from = at.checked_sub(distance)?;
    if at + length > out.len() {
        return None;
    }
    let mut done = 0;
    if distance >= STEP && at + length + STEP <= out.len() {
        while done < length {
            let step: [u8; STEP] = *out.get(from + done..)?.first_chunk()?;
            *out.get_mut(at + done..)?.first_chunk_mut()? = step;
            done += STEP;
        }
    }
    while done < length {
        // What was copied so far repeats with the same period, so each turn may copy twice as much.
        let step = (length - done).min(distance + done);
        out.copy_within(from..from + step, at + done);
        done += step;
    }
    Some(())
}

/// Compresses `input` so that [`decompress`] and other readers of LZF give it back. Positions must
/// fit 32 bits, as PCD's size words do.
///
/// Greedy, with a table of the last place of each hash of three bytes.
pub(crate) fn compress(input: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(input.len() / 2);
    let mut table = vec![0u32; 1 << HASH_BITS];
    let mut literal_start = 0;
    let mut at = 0;
    while let Some(three) = input.get(at..).and_then(|rest| rest.first_chunk::<3>()) {
        // Position 0 stands for "never seen", so a match with the very first byte is not found.
        let seen = table
            .get_mut(hash(*three))
            .map_or(0, |slot| std::mem::replace(slot, at as u32) as usize);
        let length = match at - seen {
            distance if seen > 0 && distance <= FURTHEST => match_length(input, seen, at),
            _ => 0,
        };
        if length < 3 {
            at += 1;
            continue;
        }
        put_literals(&mut out, input.get(literal_start..at).unwrap_or_default());
        put_match(&mut out, at - seen - 1, length);
        at += length;
        literal_start = at;
    }
    put_literals(&mut out, input.get(literal_start..).unwrap_or_default());
    out
}

fn hash([a, b, c]: [u8; 3]) -> usize {
    let key = u32::from_le_bytes([a, b, c, 0]);
    (key.wrapping_mul(0x9E37_79B1) >> (32 - HASH_BITS)) as usize
}

/// How many bytes agree from `earlier` and from `at` on.
fn match_length(input: &[u8], earlier: usize, at: usize) -> usize {
    let (Some(a), Some(b)) = (input.get(earlier..), input.get(at..)) else {
        return 0;
    };
    a.iter()
        .zip(b)
        .take(LONGEST_MATCH)
        .take_while(|(x, y)| x == y)
        .count()
}

fn put_literals(out: &mut Vec<u8>, literals: &[u8]) {
    for run in literals.chunks(LONGEST_LITERAL) {
        out.push((run.len() - 1) as u8);
        out.extend_from_slice(run);
    }
}

/// `offset` is the distance less one.
fn put_match(out: &mut Vec<u8>, offset: usize, length: usize) {
    let code = length - 2;
    let high = (offset >> 8) as u8;
    if code < 7 {
        out.push((code as u8) << 5 | high);
    } else {
        out.push(7 << 5 | high);
        out.push((code - 7) as u8);
    }
    out.push(offset as u8);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_hand_made_stream_decompresses() {
        // "abc", then 5 bytes from 3 back (overlapping), then a long match of 1 back.
        let stream = [2, b'a', b'b', b'c', 3 << 5, 2, 7 << 5, 1, 0];
        assert_eq!(decompress(&stream, 18).unwrap(), b"abcabcabbbbbbbbbbb");
        assert_eq!(decompress(&stream, 17), Err(6));
        assert_eq!(decompress(&stream, 5), Err(4));
        assert_eq!(decompress(&stream, 2), Err(0));
        assert_eq!(decompress(&stream, 19), Err(9));
    }

    #[test]
    fn broken_streams_name_the_block() {
        assert_eq!(decompress(&[5, 1, 2], 6), Err(0), "cut literal");
        assert_eq!(decompress(&[0, 9, 0x20], 4), Err(2), "cut match");
        assert_eq!(decompress(&[0, 9, 0xE0, 1], 20), Err(2), "cut long match");
        assert_eq!(
            decompress(&[0, 9, 0x20, 1], 4),
            Err(2),
            "match before the start"
        );
        assert_eq!(decompress(&[], 1), Err(0));
        assert_eq!(decompress(&[], 0), Ok(vec![]));
    }

    #[test]
    fn runs_and_repeats_become_small() {
        for input in [
            vec![0u8; 100_000],
            b"winze ".repeat(5_000),
            vec![7; 3],
            vec![],
        ] {
            let packed = compress(&input);
            assert!(
                packed.len() <= input.len() / 30 + 12,
                "{} of {}",
                packed.len(),
                input.len()
            );
            assert!(packed.len() * MOST_EXPANSION >= input.len());
            assert_eq!(decompress(&packed, input.len()).unwrap(), input);
        }
    }

    #[test]
    fn matches_at_the_furthest_distance_are_found_again() {
        let noise: Vec<u8> = (0..FURTHEST as u32 + 3)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        for cut in FURTHEST - 2..FURTHEST + 3 {
            let input = [b"#unique#", &noise[..cut], b"#unique#"].concat();
            assert_eq!(decompress(&compress(&input), input.len()).unwrap(), input);
        }
    }

    fn unpacked(input: &[u8], size: usize) -> Result<Vec<u8>, usize> {
        let mut out = Vec::new();
        unpack(&mut &input[..], input.len() as u64, size as u64, &mut out)
            .unwrap()
            .map_err(|at| at as usize)?;
        Ok(out)
    }

    #[test]
    fn many_windows_unpack_as_at_once() {
        let mut input: Vec<u8> = (0..1_500_000u32)
            .map(|i| {
                (i.wrapping_mul(i ^ 2_654_435_761) >> 13) as u8
                    & if i % 70_000 < 9_000 { 1 } else { 255 }
            })
            .collect();
        input.extend(vec![5; 900_000]);
        let packed = compress(&input);
        assert!(packed.len() > WINDOW);
        assert!(unpacked(&packed, input.len()).unwrap() == input);
        for size in [input.len() - 1, input.len() + 1] {
            assert_eq!(unpacked(&packed, size), decompress(&packed, size));
        }
        let mut broken = packed;
        let middle = broken.len() / 2;
        for i in 0..60 {
            broken[middle + i] = broken[middle + i].wrapping_add(37);
            assert_eq!(
                unpacked(&broken, input.len()),
                decompress(&broken, input.len())
            );
        }
    }

    proptest! {
        #[test]
        fn what_is_compressed_comes_back(input in proptest::collection::vec(0u8..6, 0..3000)) {
            prop_assert_eq!(decompress(&compress(&input), input.len()).unwrap(), input);
        }

        #[test]
        fn any_bytes_decompress_to_the_size_or_fail(input in proptest::collection::vec(any::<u8>(), 0..200), size in 0usize..2000) {
            prop_assert_eq!(unpacked(&input, size), decompress(&input, size));
            if let Ok(out) = decompress(&input, size) {
                prop_assert_eq!(out.len(), size);
                prop_assert!(size <= input.len() * MOST_EXPANSION);
            }
        }
    }
}
