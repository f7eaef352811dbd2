//! The two streams: data on stdout, talk on stderr.

use std::io::{self, Write as _};

/// Writes data to stdout.
pub(crate) fn print(text: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}

/// Writes talk to stderr; if that fails there is nobody left to tell.
pub(crate) fn talk(text: &str) {
    let _ = io::stderr().lock().write_all(text.as_bytes());
}

/// An error in one line, causes after it.
pub(crate) fn complain(e: &anyhow::Error) {
    let message = format!("{e:#}").replace('\n', " ");
    talk(&format!("winze: error: {message}\n"));
}
