//! Writes `.usda` text: indented blocks, numbers, strings, asset paths.
//!
//! Source: the grammar of OpenUSD's text file format (`pxr/usd/sdf/usdaFileFormat`). Numbers are the shortest that read
//! back as the same `f32`. Strings stay on one line and in ASCII where the grammar has an escape; other characters are
//! UTF-8 as they are, which the format allows.

use crate::output::Error;
use core::fmt::Display;
use std::path::Path;

/// Values on one line of a long list, so that tools for text can show it.
const PER_LINE: usize = 8;

/// Text that grows, with the depth of blocks.
#[derive(Debug, Default)]
pub(super) struct Text {
    out: String,
    depth: usize,
}

impl Text {
    /// A layer with its metadata; `lines` go between the parentheses.
    pub(super) fn layer(lines: &[String]) -> Self {
        let mut text = Self::default();
        text.line("#usda 1.0");
        text.line("(");
        text.depth = 1;
        lines.iter().for_each(|l| text.line(l));
        text.depth = 0;
        text.line(")");
        text
    }

    pub(super) fn line(&mut self, line: impl Display) {
        let pad = 4 * self.depth;
        self.out += &format!("{:pad$}{line}\n", "");
    }

    /// `head` with metadata lines, and a block that `body` fills.
    pub(super) fn prim<R>(&mut self, head: &str, metadata: &[String], body: impl FnOnce(&mut Self) -> R) -> R {
        if metadata.is_empty() {
            self.line(head);
        } else {
            self.line(format!("{head} ("));
            self.depth += 1;
            metadata.iter().for_each(|m| self.line(m));
            self.depth -= 1;
            self.line(")");
        }
        self.line("{");
        self.depth += 1;
        let result = body(self);
        self.depth -= 1;
        self.line("}");
        result
    }

    /// An attribute that is a list, with metadata.
    pub(super) fn list(&mut self, name: &str, values: impl Iterator<Item = String>, metadata: &str) {
        let mut values = values.peekable();
        let after = if metadata.is_empty() { String::new() } else { format!(" ({metadata})") };
        let first: Vec<String> = values.by_ref().take(PER_LINE).collect();
        if values.peek().is_none() {
            return self.line(format!("{name} = [{}]{after}", first.join(", ")));
        }
        self.line(format!("{name} = ["));
        self.depth += 1;
        self.line(format!("{},", first.join(", ")));
        while values.peek().is_some() {
            let row: Vec<String> = values.by_ref().take(PER_LINE).collect();
            let comma = if values.peek().is_some() { "," } else { "" };
            self.line(format!("{}{comma}", row.join(", ")));
        }
        self.depth -= 1;
        self.line(format!("]{after}"));
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.out.into_bytes()
    }
}

/// A number; whole ones without a fraction.
pub(super) fn number(value: f32) -> String {
    let text = format!("{value:?}");
    text.strip_suffix(".0").map_or_else(|| text.clone(), str::to_owned)
}

/// A tuple of numbers.
pub(super) fn tuple(values: &[f32]) -> String {
    let all: Vec<String> = values.iter().map(|&v| number(v)).collect();
    format!("({})", all.join(", "))
}

/// A string in quotes.
pub(super) fn string(value: &str) -> String {
    let mut out = String::from("\"");
    for c in value.chars() {
        match c {
            '"' => out += "\\\"",
            '\\' => out += "\\\\",
            '\n' => out += "\\n",
            '\r' => out += "\\r",
            '\t' => out += "\\t",
            c if (c as u32) < 0x20 || c as u32 == 0x7f => out += &format!("\\x{:02x}", c as u32),
            c => out.push(c),
        }
    }
    out.push('"');
    out
}

/// An asset path between delimiters. `file` is what it leads to, for messages.
///
/// # Errors
/// If the path has a control character or three `@` in a row, for which the grammar has no spelling that all readers
/// know.
pub(super) fn asset(path: &str, file: &Path) -> Result<String, Error> {
    if path.chars().any(char::is_control) || path.contains("@@@") || path.ends_with('@') {
        return Err(Error::invalid(file, "a USD file cannot refer to a file of this name; rename it"));
    }
    let mark = if path.contains('@') { "@@@" } else { "@" };
    Ok(format!("{mark}{path}{mark}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back() {
        for value in [0.1f32, 1e-7, 16_777_216.0, -0.0, f32::MIN_POSITIVE, f32::MAX, 1.0 / 3.0] {
            assert_eq!(number(value).parse::<f32>().unwrap().to_bits(), value.to_bits());
        }
        assert_eq!(tuple(&[1.0, -0.5, 1e-7]), "(1, -0.5, 1e-7)");
    }

    #[test]
    fn strings_are_escaped() {
        assert_eq!(string("a\"b\\c\nd\u{1}é"), r#""a\"b\\c\nd\x01é""#);
    }

    #[test]
    fn asset_paths_have_delimiters_that_fit() {
        let spell = |path: &str| asset(path, Path::new("x"));
        assert_eq!(spell("./a b.exr").unwrap(), "@./a b.exr@");
        assert_eq!(spell("./a@2x.png").unwrap(), "@@@./a@2x.png@@@");
        for bad in ["a@@@b", "a\nb", "a@"] {
            assert!(spell(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn long_lists_are_broken() {
        let mut text = Text::default();
        text.prim("def Mesh \"m\"", &["a = 1".to_owned()], |t| t.list("int[] x", (0..9).map(|i| i.to_string()), ""));
        let text = String::from_utf8(text.into_bytes()).unwrap();
        assert_eq!(text.lines().nth(5), Some("        0, 1, 2, 3, 4, 5, 6, 7,"));
        assert_eq!(text.lines().last(), Some("}"));
    }
}
