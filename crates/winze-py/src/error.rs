//! Errors of the Rust crates as Python's own exceptions.

use std::io;

use pyo3::PyErr;
use pyo3::exceptions::{
    PyFileExistsError, PyFileNotFoundError, PyIsADirectoryError, PyOSError, PyPermissionError,
    PyValueError,
};

/// What the system refused as the `OSError` that Python has for it, everything else as `ValueError`, with the message that the
/// command line gives.
pub(crate) fn raise(e: impl Into<anyhow::Error>) -> PyErr {
    let e = e.into();
    let text = format!("{e:#}");
    raise_saying(&e, text)
}

/// The same with another message.
pub(crate) fn raise_saying(e: &anyhow::Error, text: String) -> PyErr {
    for cause in e.chain() {
        if let Some(cause) = cause.downcast_ref::<io::Error>() {
            return of_system(cause, text);
        }
        if let Some(cause) = cause.downcast_ref::<winze_io::Error>() {
            return of_file(cause, text);
        }
        match cause.downcast_ref::<winze_map::Error>() {
            Some(winze_map::Error::Exists { .. }) => return PyFileExistsError::new_err(text),
            Some(winze_map::Error::Io(cause)) => return of_file(cause, text),
            Some(winze_map::Error::Scratch { cause, .. }) => return of_system(cause, text),
            _ => {}
        }
    }
    PyValueError::new_err(text)
}

fn of_file(cause: &winze_io::Error, text: String) -> PyErr {
    match cause {
        winze_io::Error::Io { cause, .. } => of_system(cause, text),
        winze_io::Error::Folder { .. } => PyIsADirectoryError::new_err(text),
        winze_io::Error::ReadOnly { .. } => PyPermissionError::new_err(text),
        _ => PyValueError::new_err(text),
    }
}

fn of_system(cause: &io::Error, text: String) -> PyErr {
    match cause.kind() {
        io::ErrorKind::NotFound => PyFileNotFoundError::new_err(text),
        io::ErrorKind::PermissionDenied => PyPermissionError::new_err(text),
        io::ErrorKind::AlreadyExists => PyFileExistsError::new_err(text),
        io::ErrorKind::IsADirectory => PyIsADirectoryError::new_err(text),
        _ => PyOSError::new_err(text),
    }
}
