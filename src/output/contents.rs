//! What goes into a file, in pieces: bytes that are there, and bytes that are made when the file is written.
//!
//! A scene with thousands of instances has as many copies of its meshes' lightmap coordinates in its document: 230 MB of
//! them for 5,000 copies of 5,600 vertices. Held at once, and put together to one buffer, they took four times that.
//!
//! Invariant: what a piece makes has the length that was promised for it, whenever it is made.

use std::borrow::Cow;
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;

/// A file with its contents.
pub type File = (PathBuf, Contents);
/// Several of them.
pub type Files = Vec<File>;

/// Contents of a file. Copies of it share their pieces.
#[derive(Clone, Default, Debug)]
pub struct Contents {
    pieces: Vec<Piece>,
    length: usize,
}

#[derive(Clone)]
enum Piece {
    There(Arc<Vec<u8>>),
    Promised(Arc<dyn Fn() -> Vec<u8> + Send + Sync>),
}

impl Contents {
    /// Number of bytes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.length
    }

    /// There is nothing in it.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Appends bytes.
    pub fn extend(&mut self, bytes: &[u8]) {
        self.length += bytes.len();
        if let Some(Piece::There(last)) = self.pieces.last_mut()
            && let Some(own) = Arc::get_mut(last)
        {
            own.extend_from_slice(bytes);
        } else {
            self.pieces.push(Piece::There(Arc::new(bytes.to_vec())));
        }
    }

    /// Appends zeros until there are `length` bytes; does nothing where there are as many.
    pub fn pad(&mut self, length: usize) {
        if let Some(missing) = length.checked_sub(self.length).filter(|missing| *missing > 0) {
            self.extend(&vec![0; missing]);
        }
    }

    /// Appends bytes that are made when they are needed, perhaps more than once; always these, and `length` of them.
    pub fn promise(&mut self, length: usize, make: impl Fn() -> Vec<u8> + Send + Sync + 'static) {
        self.pieces.push(Piece::Promised(Arc::new(make)));
        self.length += length;
    }

    /// Appends what others have.
    pub fn append(&mut self, other: Self) {
        self.length += other.length;
        self.pieces.extend(other.pieces);
    }

    /// The pieces one after the other.
    pub fn pieces(&self) -> impl Iterator<Item = Cow<'_, [u8]>> {
        self.pieces.iter().map(|piece| match piece {
            Piece::There(bytes) => Cow::Borrowed(bytes.as_slice()),
            Piece::Promised(make) => Cow::Owned(make()),
        })
    }

    /// All but the first piece.
    pub(super) fn after_first(&self) -> Self {
        let pieces = self.pieces.get(1..).unwrap_or_default().to_vec();
        let first = self.pieces().next().map_or(0, |piece| piece.len());
        Self { pieces, length: self.length - first }
    }

    /// All of it in one piece.
    #[must_use]
    pub fn to_vec(&self) -> Vec<u8> {
        let mut all = Vec::with_capacity(self.length);
        self.pieces().for_each(|piece| all.extend_from_slice(&piece));
        all
    }
}

impl From<Vec<u8>> for Contents {
    fn from(bytes: Vec<u8>) -> Self {
        Self { length: bytes.len(), pieces: vec![Piece::There(Arc::new(bytes))] }
    }
}

impl fmt::Debug for Piece {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::There(bytes) => write!(f, "{} bytes", bytes.len()),
            Self::Promised(_) => f.write_str("promised bytes"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_come_in_their_order_and_copies_do_not_change_each_other() {
        let mut contents = Contents::from(vec![1, 2]);
        contents.promise(3, || vec![3; 3]);
        contents.extend(&[4]);
        let mut copy = contents.clone();
        contents.extend(&[5]);
        copy.extend(&[6]);
        copy.pad(8);
        copy.pad(2);
        assert_eq!((contents.len(), contents.to_vec()), (7, vec![1, 2, 3, 3, 3, 4, 5]));
        assert_eq!((copy.len(), copy.to_vec()), (8, vec![1, 2, 3, 3, 3, 4, 6, 0]));
        contents.append(copy);
        assert_eq!((contents.len(), contents.to_vec().len()), (15, 15));
        assert!(Contents::default().is_empty() && !contents.is_empty());
    }
}
