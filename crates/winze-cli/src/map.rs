//! `winze map`: maps that are prepared once and kept.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, UNIX_EPOCH};

use winze_front::memory::half_of_what_is_free;
use winze_front::{Facts, settings};
use winze_map::{BuildOptions, Map, Progress as BuildProgress};

use crate::args::{Global, MapBuild, MapCheck, MapInfo, MapVerb};
use crate::output::{check_outputs, complain, print};
use crate::progress::Progress;

pub(crate) fn run(verb: &MapVerb, global: &Global) -> anyhow::Result<ExitCode> {
    match verb {
        MapVerb::Build(args) => build(args, global)?,
        MapVerb::Info(args) => info(args)?,
        MapVerb::Check(args) => return check(args, global),
    }
    Ok(ExitCode::SUCCESS)
}

fn build(args: &MapBuild, global: &Global) -> anyhow::Result<()> {
    let config = settings::effective(&global.layers())?;
    let inputs: Vec<&Path> = args
        .clouds
        .iter()
        .chain(&global.config)
        .map(std::path::PathBuf::as_path)
        .collect();
    check_outputs(&[&args.out], &inputs)?;
    let begun = Instant::now();
    let progress = Progress::shared(global.quiet);
    let under_way = Mutex::new((String::new(), begun));
    let told = |p: &BuildProgress<'_>| {
        progress.share(p.step, p.done);
        let mut under_way = under_way.lock().unwrap_or_else(PoisonError::into_inner);
        let (step, since) = &mut *under_way;
        if step != p.step {
            if !step.is_empty() {
                tracing::info!("{step}: {:.3} s", since.elapsed().as_secs_f64());
            }
            (*step, *since) = (p.step.to_owned(), Instant::now());
        }
    };
    let options = BuildOptions {
        memory: args.memory.unwrap_or_else(half_of_what_is_free),
        replace: args.force,
        crs: args.crs.as_deref(),
        scratch: args.scratch.as_deref(),
        progress: Some(&told),
        ..BuildOptions::default()
    };
    let meta = winze_map::build(&args.clouds, &args.out, &config, &options)?;
    progress.finish();
    for source in &meta.sources {
        let [non_finite, no_returns, far] = source.dropped;
        if non_finite + far > 0 {
            tracing::warn!(
                "{}: of {} points {non_finite} are not finite and {far} lie far from the rest; they were dropped",
                source.name.escape_debug(),
                source.points
            );
        }
        if no_returns > 0 {
            tracing::warn!(
                "{}: {no_returns} points at exactly (0, 0, 0) were taken for beams without a return and dropped",
                source.name.escape_debug()
            );
        }
    }
    if !global.quiet {
        let map = Map::open(&args.out)?;
        print(&format!(
            "{}{:<13} {}\n",
            words(&args.out, &map, false),
            "built in",
            in_words(begun.elapsed())
        ))?;
    }
    Ok(())
}

/// All of them, whatever is wrong with the first.
fn check(args: &MapCheck, global: &Global) -> anyhow::Result<ExitCode> {
    let mut code = ExitCode::SUCCESS;
    for file in &args.files {
        let progress = Progress::shared(global.quiet);
        let checked = Map::open(file).and_then(|map| {
            map.check(&mut |done, all| {
                #[expect(clippy::cast_precision_loss, reason = "a share")]
                progress.share("verify", done as f64 / all.max(1) as f64);
            })?;
            Ok(map)
        });
        progress.finish();
        let map = match checked {
            Ok(map) => map,
            Err(e) => {
                complain(&e.into());
                code = ExitCode::from(2);
                continue;
            }
        };
        let unknown = map.unknown_sections().count();
        let mut line = format!(
            "{}: sound: {} sections, {}",
            file.display(),
            map.sections().len(),
            size(map.length())
        );
        if unknown > 0 {
            let _ = write!(line, "; {unknown} of them are of a newer winze");
        }
        print(&(line + "\n"))?;
    }
    Ok(code)
}

fn info(args: &MapInfo) -> anyhow::Result<()> {
    let map = Map::open(&args.file)?;
    if !args.json {
        return print(&words(&args.file, &map, true));
    }
    let facts = Facts::of(&args.file, &map);
    print(&(serde_json::to_string(&facts)? + "\n"))
}

/// A map in words; in full with its sections.
fn words(path: &Path, map: &Map, full: bool) -> String {
    let m = map.meta();
    let mut out = String::new();
    let mut line = |what: &str, text: String| {
        let _ = writeln!(out, "{what:<13} {text}");
    };
    line("map", path.display().to_string());
    let per_point = m.levels.first().map_or(0, |l| l.points).max(1);
    line(
        "size",
        format!(
            "{}, {} a point of the finest level",
            size(map.length()),
            size(map.length() / per_point)
        ),
    );
    line("points", format!("{} of its clouds", grouped(m.points)));
    let [low, high] = m.bounds;
    let corner = |p: [f64; 3]| format!("{:.3} {:.3} {:.3} m", p[0], p[1], p[2]);
    line("from", corner(low));
    line("to", corner(high));
    let [low, high] = m.robust_bounds;
    let extent: [f64; 3] = std::array::from_fn(|a| high[a] - low[a]);
    line(
        "extent",
        format!(
            "{:.1} x {:.1} x {:.1} m, all but the outermost 0.1 % at each end",
            extent[0], extent[1], extent[2]
        ),
    );
    if m.origin != [0.0; 3] {
        line("origin", corner(m.origin));
    }
    // Texts of a file are somebody's, and may hold what a terminal obeys.
    let printable = |text: &str| text.escape_debug().to_string();
    line(
        "CRS",
        m.crs.as_deref().map_or("not known".into(), printable),
    );
    line(
        "spacing",
        format!(
            "{:.3} m from point to point, in the median",
            m.measure.spacing
        ),
    );
    line(
        "passages",
        match (m.measure.width, m.measure.width_range) {
            (Some(width), Some([narrow, wide])) => format!(
                "about {width:.1} m across; a tenth of them under {narrow:.1} m, a tenth over {wide:.1} m"
            ),
            _ => "no two walls face each other".into(),
        },
    );
    line(
        "noise floor",
        m.noise_floor.map_or_else(
            || "too few points to tell".into(),
            |noise| {
                format!(
                    "walls are {:.1} mm thick (RMS, over patches of {:.2} m; roughness included)",
                    1000.0 * noise,
                    m.noise_patch
                )
            },
        ),
    );
    for level in &m.levels {
        let cells: Vec<String> = level
            .ndt_sizes
            .iter()
            .zip(&level.ndt_cells)
            .map(|(size, n)| format!("{} of {size:.2} m", grouped(*n)))
            .collect();
        line(
            "level",
            format!(
                "{:.3} m: {} points, {} keypoints ({} by the ISS test), Gaussians: {}",
                level.voxel,
                grouped(level.points),
                grouped(level.keypoints),
                grouped(level.qualified),
                cells.join(", ")
            ),
        );
    }
    for source in &m.sources {
        let when = source
            .modified
            .map_or_else(String::new, |t| format!(", of {}", date(t)));
        line(
            "source",
            format!(
                "{}: {}, {} points, {}{when}",
                printable(&source.name),
                printable(&source.format),
                grouped(source.points),
                size(source.bytes)
            ),
        );
        if full {
            line("", printable(&source.digest));
        }
    }
    if full {
        let built = std::fs::metadata(path)
            .and_then(|f| f.modified())
            .ok()
            .and_then(|t| t.duration_since(UNIX_EPOCH).ok());
        let when = built.map_or_else(String::new, |t| format!(" on {}", date(t.as_secs())));
        line("built", format!("by winze {}{when}", printable(&m.winze)));
        line("settings", printable(&m.config_digest));
        line("digest", map.digest());
        let unknown: Vec<_> = map.unknown_sections().map(|e| e.id).collect();
        for e in map.sections() {
            let mut text = format!("{:<8} {:>10}", e.id.to_string(), size(e.length));
            if unknown.contains(&e.id) {
                text += "  of a newer winze, passed over";
            }
            line("section", text);
        }
    }
    out
}

/// Bytes as people read them.
fn size(bytes: u64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "rounded anyway")]
    let mut value = bytes as f64;
    for unit in ["B", "KiB", "MiB"] {
        if value < 1024.0 {
            let digits = usize::from(unit != "B");
            return format!("{value:.digits$} {unit}");
        }
        value /= 1024.0;
    }
    format!("{value:.2} GiB")
}

/// With a space at each thousand.
fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(' ');
        }
        out.push(digit);
    }
    out
}

fn in_words(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    if seconds < 120.0 {
        return format!("{seconds:.1} s");
    }
    format!(
        "{:.0} min {:.0} s",
        (seconds / 60.0).floor(),
        seconds % 60.0
    )
}

/// Seconds since 1970 as a date and a time, UTC.
fn date(seconds: u64) -> String {
    let days = seconds / 86_400;
    // Howard Hinnant's days-to-civil, for days after 1970.
    let z = days + 719_468;
    let era = z / 146_097;
    let of_era = z % 146_097;
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 {
        shifted + 3
    } else {
        shifted - 9
    };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute) = (seconds / 3600 % 24, seconds / 60 % 60);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_as_people_read_them() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1_234_567), "1 234 567");
        assert_eq!(size(12), "12 B");
        assert_eq!(size(1536), "1.5 KiB");
        assert_eq!(size(3 << 30), "3.00 GiB");
        assert_eq!(date(0), "1970-01-01 00:00 UTC");
        assert_eq!(date(951_782_400), "2000-02-29 00:00 UTC");
        assert_eq!(date(1_795_359_000), "2026-11-22 14:50 UTC");
        assert_eq!(in_words(Duration::from_secs(185)), "3 min 5 s");
    }
}
