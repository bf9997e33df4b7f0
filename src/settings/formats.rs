//! What `--format` means, and the options that need an EXR among the formats.

use super::{Invalid, Options};
use crate::output::formats::Format;

impl Options {
    /// The formats, each once, in the order in which they were given.
    pub(super) fn formats(&self) -> Result<Vec<Format>, Invalid> {
        let mut formats: Vec<Format> = vec![];
        for format in self.format.as_deref().unwrap_or(&[Format::Exr]) {
            if !formats.contains(format) {
                formats.push(*format);
            }
        }
        if formats.is_empty() {
            return Err(Invalid("--format needs at least one format, for example exr".into()));
        }
        let wanted = [("--exr-image", self.exr_image), ("--preview-gltf", self.preview_gltf)];
        if let Some((option, _)) = wanted.iter().find(|(_, on)| *on == Some(true) && !formats.contains(&Format::Exr)) {
            return Err(Invalid(format!("{option} shows the EXR; add exr to --format")));
        }
        Ok(formats)
    }

    /// Mip levels that the formats need: a block of 4 × 4 texels has few bits, and wastes them where it mixes charts.
    pub(super) fn least_mips(&self) -> u32 {
        if self.format.as_ref().is_some_and(|f| f.contains(&Format::Ktx2)) { 2 } else { 0 }
    }
}

/// Nothing but the default; it is left out of what outputs say of their settings.
pub(super) fn exr_alone(formats: &[Format]) -> bool {
    formats == [Format::Exr]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_keep_their_order_and_some_options_need_exr() {
        let read = |text: &str| Options::from_toml(text).unwrap().settings();
        let some = read("format = [\"rgbm\", \"exr\", \"rgbm\"]\nexr-image = true").unwrap();
        assert_eq!(some.format, [Format::Rgbm, Format::Exr]);
        assert!(serde_json::to_string(&some).unwrap().contains("rgbm"));
        assert!(!serde_json::to_string(&read("").unwrap()).unwrap().contains("format"));
        for option in ["exr-image", "preview-gltf"] {
            let message = read(&format!("format = [\"hdr\"]\n{option} = true")).unwrap_err().to_string();
            assert!(message.contains(option) && message.contains("--format"), "{message}");
            assert!(read(&format!("format = [\"hdr\"]\n{option} = false")).is_ok());
        }
        assert_eq!([some.mips, read("mips = 3").unwrap().mips, read("format = [\"ktx2\"]").unwrap().mips], [0, 3, 2]);
        assert!(read("mips = 7").unwrap_err().to_string().contains("--mips"));
        assert!(read("format = []").unwrap_err().to_string().contains("--format"));
        assert!(Options::from_toml("format = [\"jpeg\"]").is_err());
    }
}
