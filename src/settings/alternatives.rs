//! Options that say the same in two ways, of which one file may use one. The command line checks its own.

use super::{Invalid, Options};

impl Options {
    /// Both of a pair are no contradiction that anybody would see: one would win without a word.
    pub(super) fn check_alternatives(&self) -> Result<(), Invalid> {
        let pairs = [
            (["texels-per-meter", "texel-size"], self.texels_per_meter.is_some() && self.texel_size.is_some()),
            (["lines", "lines-per-texel"], self.lines.is_some() && self.lines_per_texel.is_some()),
        ];
        match pairs.iter().find(|(_, both)| *both) {
            Some(([a, b], _)) => Err(Invalid(format!("{a} and {b} say the same thing; give one of them"))),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_one_of_two_alternatives() {
        for both in ["texels-per-meter = 3\ntexel-size = 0.1", "lines = 10\nlines-per-texel = 1"] {
            let error = Options::from_toml(both).unwrap_err().to_string();
            assert!(both.split_whitespace().step_by(3).all(|name| error.contains(name)), "{error}");
            assert!(both.lines().all(|one| Options::from_toml(one).is_ok()));
        }
    }
}
