//! Which options need which `--target`.

use super::{Format, Invalid, Settings, Target, VertexAttribute};

impl Settings {
    /// Options of one target make no sense for the other.
    pub(super) fn check_target(&self) -> Result<(), Invalid> {
        let for_vertices = [
            ("--subdivide", self.subdivide.is_some()),
            ("--vertex-attribute", self.vertex_attribute.is_some()),
            ("--vertex-scale", self.vertex_scale.is_some()),
            ("--unlit", self.unlit),
        ];
        let for_lightmaps = [
            ("--cut-contacts", self.cut_contacts),
            ("--aov", !self.aov.is_empty()),
            ("--directional", self.is_directional()),
            ("--light-groups", self.light_groups),
            ("--quantize-uv", self.quantize_uv),
            ("--format", self.format != [Format::Exr]),
            ("--exr-image", self.exr_image),
            ("--preview-gltf", self.preview_gltf),
        ];
        let (other, needed) = match self.target {
            Target::Lightmap => (for_vertices.as_slice(), "vertex"),
            Target::Vertex => (for_lightmaps.as_slice(), "lightmap"),
        };
        if let Some((option, _)) = other.iter().find(|(_, given)| *given) {
            return Err(Invalid(format!("{option} needs --target {needed}")));
        }
        let color = !matches!(self.vertex_attribute, None | Some(VertexAttribute::Lightmap));
        match [("--vertex-scale", self.vertex_scale.is_some()), ("--unlit", self.unlit)]
            .iter()
            .find(|(_, given)| *given)
        {
            Some((option, _)) if !color => Err(Invalid(format!("{option} needs --vertex-attribute color0 or both"))),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::settings::{Options, Target};

    #[test]
    fn options_of_the_other_target_are_refused() {
        let wrong = |text: &str| Options::from_toml(text).unwrap().settings().unwrap_err().to_string();
        assert_eq!(wrong("subdivide = 0.1"), "--subdivide needs --target vertex");
        assert_eq!(wrong("target = \"vertex\"\nlight-groups = true"), "--light-groups needs --target lightmap");
        assert_eq!(wrong("target = \"vertex\"\nunlit = true"), "--unlit needs --vertex-attribute color0 or both");
        let good = Options::from_toml("target = \"vertex\"\nvertex-attribute = \"both\"\nunlit = true").unwrap();
        assert_eq!(good.settings().unwrap().target, Target::Vertex);
    }
}
