//! Through binary elements in order, in memory or in a file.

use std::fs::File;
use std::io::{self, BufRead, BufReader};

use super::decode::cut;
use super::header::{Element, Kind};
use crate::error::{Fault, Place};
use crate::scalar::{Order, Scalar};

/// Bytes that are read in order.
pub(super) trait Source: BufRead {
    /// Passes `bytes` that are there.
    fn skip(&mut self, bytes: u64) -> io::Result<()>;
}

impl Source for &[u8] {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        let bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
        *self = self.get(bytes..).ok_or(io::ErrorKind::UnexpectedEof)?;
        Ok(())
    }
}

impl Source for BufReader<File> {
    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        self.seek_relative(i64::try_from(bytes).map_err(io::Error::other)?)
    }
}

/// The elements of a binary file from one of them on.
#[derive(Debug)]
pub(super) struct Body<S> {
    source: S,
    order: Order,
    /// Bytes that are left.
    left: u64,
}

impl<S: Source> Body<S> {
    /// From a source of `length` bytes.
    pub(super) fn new(source: S, order: Order, length: u64) -> Self {
        Self {
            source,
            order,
            left: length,
        }
    }

    pub(super) fn left(&self) -> u64 {
        self.left
    }

    /// What follows.
    pub(super) fn into_source(self) -> S {
        self.source
    }

    /// The next number; `None` where the data ends before.
    fn number(&mut self, scalar: Scalar) -> io::Result<Option<f64>> {
        let size = scalar.size() as u64;
        if self.left < size {
            return Ok(None);
        }
        let mut bytes = [0; 8];
        let bytes = bytes.get_mut(..scalar.size()).unwrap_or_default();
        self.source.read_exact(bytes)?;
        self.left -= size;
        Ok(scalar.first(self.order, bytes))
    }

    /// Whether so many bytes were there, which are then passed.
    fn skip(&mut self, bytes: u64) -> io::Result<bool> {
        if bytes == 0 {
            return Ok(true);
        }
        let Some(left) = self.left.checked_sub(bytes) else {
            return Ok(false);
        };
        self.source.skip(bytes)?;
        self.left = left;
        Ok(true)
    }

    /// Passes whole elements.
    pub(super) fn skip_elements(&mut self, elements: &[Element]) -> Result<(), Fault> {
        for element in elements {
            let Some(size) = element.fixed_size() else {
                self.walk(element, |_, _| Ok(()))?;
                continue;
            };
            let there = match element.count.checked_mul(size) {
                Some(bytes) => self.skip(bytes)?,
                None => false,
            };
            if !there {
                return Err(cut(element, self.left / size.max(1)));
            }
        }
        Ok(())
    }

    /// Goes through all rows of an element with lists and calls `visit` with each property's index
    /// and its value, or its length if it is a list.
    pub(super) fn walk(
        &mut self,
        element: &Element,
        mut visit: impl FnMut(usize, f64) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        let start = self.left;
        for row in 0..element.count {
            for (i, property) in element.properties.iter().enumerate() {
                let (head, item) = match property.kind {
                    Kind::Scalar(scalar) => (scalar, None),
                    Kind::List { count, item } => (count, Some(item)),
                };
                let offset = start - self.left;
                let value = self.number(head)?.ok_or_else(|| cut(element, row))?;
                let items = match item {
                    // A count beyond all data saturates and is then not there.
                    Some(item) if value >= 0.0 => (value as u64).saturating_mul(item.size() as u64),
                    Some(_) => {
                        let name = &property.name;
                        return Err(Fault::malformed(
                            Place::Line(element.line),
                            format!(
                                "list {name} has a length of {value}, {offset} bytes into the element; the file is damaged"
                            ),
                        ));
                    }
                    None => 0,
                };
                if !self.skip(items)? {
                    return Err(cut(element, row));
                }
                visit(i, value)?;
            }
        }
        Ok(())
    }
}
