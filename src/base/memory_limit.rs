//! The most memory that a bake may take, and who says so.

use core::fmt;

/// A number of bytes that may not be passed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemoryLimit {
    /// The user asks for it.
    Asked(u64),
    /// The machine, or the container, has no more.
    Machine(u64),
}

impl MemoryLimit {
    /// So many bytes are too many.
    #[must_use]
    pub const fn refuses(self, bytes: u64) -> bool {
        let (Self::Asked(limit) | Self::Machine(limit)) = self;
        bytes > limit
    }
}

/// For people: `the limit of 8.0 GiB`, or of less than a MiB as it is: nothing fits into `0 MiB`.
impl fmt::Display for MemoryLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Asked(limit @ 0..0x10_0000) => write!(f, "the limit of {limit} bytes"),
            Self::Asked(limit) => write!(f, "the limit of {}", in_words(*limit)),
            Self::Machine(limit) => write!(f, "the {} of this machine", in_words(*limit)),
        }
    }
}

/// A number of bytes for people: `1.2 GiB`.
#[must_use]
pub fn in_words(bytes: u64) -> String {
    match bytes {
        0..0x4000_0000 => format!("{:.0} MiB", bytes as f64 / f64::from(1 << 20)),
        _ => format!("{:.1} GiB", bytes as f64 / f64::from(1 << 30)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_much_as_the_limit_is_allowed() {
        for limit in [MemoryLimit::Asked(7), MemoryLimit::Machine(7)] {
            assert_eq!([6, 7, 8].map(|bytes| limit.refuses(bytes)), [false, false, true]);
        }
        assert_eq!(MemoryLimit::Asked(3 << 20).to_string(), "the limit of 3 MiB");
        assert_eq!(MemoryLimit::Asked(7 << 10).to_string(), "the limit of 7168 bytes");
        assert_eq!(MemoryLimit::Machine(5 << 29).to_string(), "the 2.5 GiB of this machine");
    }
}
