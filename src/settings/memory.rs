//! Sizes of memory as people write them: `500MB`, `8GiB`, `1.5 GB`, or plain bytes.
//!
//! k, M, G, T with B are powers of 1000, with iB of 1024 (IEC 80000-13). Upper and lower case count as one.

use serde::{Deserialize, Deserializer, Serialize};
use std::str::FromStr;

/// A number of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct ByteCount(u64);

impl ByteCount {
    /// The number.
    #[must_use]
    pub const fn bytes(self) -> u64 {
        self.0
    }
}

impl FromStr for ByteCount {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
        let (number, unit) = text.split_at(digits);
        let factor = match unit.trim().to_ascii_lowercase().as_str() {
            "" | "b" => 1.0,
            "kb" => 1e3,
            "mb" => 1e6,
            "gb" => 1e9,
            "tb" => 1e12,
            "kib" => 1024.0,
            "mib" => 1024.0 * 1024.0,
            "gib" => 1024.0 * 1024.0 * 1024.0,
            "tib" => 1024.0 * 1024.0 * 1024.0 * 1024.0,
            _ => return Err(format!("\"{unit}\" is no unit of memory; use for example 500MB or 8GiB")),
        };
        let bytes = number.parse::<f64>().map_or(0.0, |n| n * factor);
        if bytes < 1.0 {
            return Err(format!("\"{text}\" is no size of memory; use for example 500MB or 8GiB"));
        }
        Ok(Self(bytes as u64))
    }
}

/// A whole number of bytes, or text.
impl<'de> Deserialize<'de> for ByteCount {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Number(u64),
            Text(String),
        }
        match Written::deserialize(deserializer)? {
            Written::Number(bytes) => Ok(Self(bytes)),
            Written::Text(text) => text.parse().map_err(serde::de::Error::custom),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Options;

    #[test]
    fn sizes_are_read_as_people_write_them() {
        let read = |text: &str| text.parse::<ByteCount>().map(ByteCount::bytes);
        let good = [("500MB", 500_000_000), ("8GiB", 8 << 30), ("1.5 gb", 1_500_000_000), ("4096", 4096)];
        for (text, bytes) in good {
            assert_eq!(read(text).unwrap_or(0), bytes, "{text}");
        }
        for bad in ["", "GB", "0", "-1GB", "8 apples", "2k", "1e9", "nan"] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn configuration_files_may_hold_them() {
        let limit = |text: &str| Options::from_toml(text).map(|o| o.settings().unwrap().memory_limit);
        assert_eq!(limit("memory-limit = \"2MiB\"").unwrap(), Some(2 << 20));
        assert_eq!(limit("memory-limit = 4096").unwrap(), Some(4096));
        assert_eq!(limit("").unwrap(), None);
        assert!(limit("memory-limit = \"much\"").unwrap_err().to_string().contains("memory"));
        let written = serde_json::to_string(&Options::from_toml("memory-limit = 4096").unwrap().settings().unwrap());
        assert!(!written.unwrap().contains("memory"));
    }
}
