//! The report of a bake, for machines. The keys are a contract: [`SCHEMA`] goes up when one changes its meaning or
//! goes.

use super::Error;
use crate::base::Warning;
use std::path::Path;

/// Version of the keys below.
pub const SCHEMA: u32 = 1;

/// Everything a build system or a test may want to know of a bake.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Report {
    /// Version of the program.
    pub version: String,
    /// [`SCHEMA`].
    pub schema: u32,
    /// Files that were read, the document first.
    pub inputs: Vec<String>,
    /// Files that were written.
    pub outputs: Vec<String>,
    /// Every setting by its long option name.
    pub settings: serde_json::Map<String, serde_json::Value>,
    /// What was baked.
    pub scene: SceneCounts,
    /// Where it lies on the pages.
    pub atlas: AtlasCounts,
    /// Primitives that rules or `extras` treat otherwise than usual.
    pub treated: Vec<Treated>,
    /// What `--cut-contacts` did; `null` without it.
    pub contacts: Option<Contacts>,
    /// The walk and its balance of power.
    pub walk: Walk,
    /// The final gather.
    pub gather: Gather,
    /// How far from the truth it may be.
    pub error: EstimatedError,
    /// The passes of the solver, and what ended them.
    pub refinement: Refinement,
    /// Steps at the borders of charts.
    pub seams: Seams,
    /// The lightmaps of groups of lights, if they were asked for.
    pub light_groups: Vec<LightGroup>,
    /// Textures of light by normal, if they were asked for.
    pub directional: Vec<DirectionalTexture>,
    /// The fit of vertex light; `null` for lightmaps.
    pub vertices: Option<Vertices>,
    /// Rays of all stages.
    pub rays: u64,
    /// `rays` over the seconds of the stages that shot them.
    pub rays_per_second: f64,
    /// In the order in which they ran.
    pub stages: Vec<Stage>,
    /// Largest resident set [bytes]; 0 where the system does not tell.
    pub peak_memory_bytes: u64,
    /// In the order in which they came up.
    pub warnings: Vec<Warning>,
}

/// Size of the scene.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct SceneCounts {
    /// Triangles, instances counted each.
    pub triangles: u64,
    /// Primitives as placed by nodes.
    pub instances: u64,
    /// Materials of the document.
    pub materials: u64,
    /// Punctual lights.
    pub lights: u64,
}

/// Size of the atlas.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct AtlasCounts {
    /// Lightmap pages.
    pub pages: u32,
    /// Width and height [texels].
    pub page_size: [u32; 2],
    /// Charts on all pages.
    pub charts: u64,
    /// Texels that a chart covers.
    pub texels: u64,
    /// Covered part of all pages, in [0, 1].
    pub utilization: f64,
    /// Mip levels in which charts do not mix.
    pub mip_levels: u32,
}

/// A primitive as placed by a node that is not treated as usual.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Treated {
    /// Name of the node.
    pub node: String,
    /// Index of the mesh and of the primitive in it.
    pub mesh: [usize; 2],
    /// Factor of the texels per metre.
    pub density: f32,
    /// It may have a lightmap.
    pub receives: bool,
    /// Others are lit as if it were there.
    pub casts: bool,
    /// Factor of the light that it emits.
    pub emission: f32,
    /// Group of what it emits, if that has a name.
    pub light_group: Option<String>,
}

/// Triangles cut where other surfaces meet them.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Contacts {
    /// Triangles that were cut.
    pub triangles_cut: u64,
    /// Triangles that were made from them.
    pub triangles_made: u64,
    /// Thin walls whose line was continued to the border of the floor.
    pub lines_continued: u64,
}

/// The walk. Powers are linear Rec.709 [lm]; in = absorbed + escaped + residual.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Walk {
    /// Lines that were shot.
    pub lines: u64,
    /// Bounces until it stopped.
    pub bounces: u32,
    /// Power that the light sources put on surfaces.
    pub power_in: [f64; 3],
    /// Power that surfaces kept.
    pub power_absorbed: [f64; 3],
    /// Power that left the scene.
    pub power_escaped: [f64; 3],
    /// Power that was not shot any more.
    pub power_residual: [f64; 3],
}

/// The final gather.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Gather {
    /// Rays of all texels.
    pub rays: u64,
    /// Mean over the texels.
    pub rays_per_texel: f64,
}

/// Error estimates.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct EstimatedError {
    /// Root mean square error over the mean; `null` where nothing was estimated.
    pub estimated_nrmse: Option<f64>,
    /// The same of the 99 % of the texels that are least bright.
    pub estimated_nrmse_99: Option<f64>,
}

/// How the solution came about.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Refinement {
    /// Error that was asked for.
    pub target_error: Option<f64>,
    /// Seconds that were asked for.
    pub time_limit: Option<f64>,
    /// `target-error`, `time-limit`, or `budget` where neither of them ended it.
    pub ended_by: String,
    /// In order; their results are averaged, weighted by budget.
    pub passes: Vec<Pass>,
}

/// One pass of the solver.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Pass {
    /// Rays and lines, as a multiple of what the settings say.
    pub budget: f64,
    /// Estimated error of this and all earlier passes together.
    pub estimated_nrmse: f64,
    /// Wall time [s].
    pub seconds: f64,
}

/// Where borders of charts meet: difference of bilinear look-ups on the two sides, over their mean. For lightmaps.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Seams {
    /// Points that were compared.
    pub points: u64,
    /// 99.9th percentile before the seams were stitched.
    pub step_before: f64,
    /// 99.9th percentile in the result.
    pub step: f64,
    /// The largest in the result.
    pub worst: f64,
    /// Where that is [m].
    pub worst_at: [f32; 3],
}

/// A group of lights.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct LightGroup {
    /// As the document has it.
    pub name: String,
    /// Its lightmap, a file per page.
    pub files: Vec<String>,
}

/// A texture of light by normal.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct DirectionalTexture {
    /// `l0`, `l1x`, `l1y`, `l1z`, or `direction`.
    pub name: String,
    /// A file per page.
    pub files: Vec<String>,
}

/// Light at vertices. Errors are those of light that is linear over the triangles against the texels: root mean square
/// over the mean.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub struct Vertices {
    /// Vertices with light.
    pub vertices: u64,
    /// Different values: vertices at one place with one normal share theirs.
    pub unknowns: u64,
    /// Triangles with light.
    pub triangles: u64,
    /// What was written.
    pub fit_nrmse: f64,
    /// What the lightmap's values at the vertices would have had.
    pub sampled_nrmse: f64,
    /// What means over the triangles around each vertex would have had.
    pub averaged_nrmse: f64,
}

/// Time of one stage.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Stage {
    /// For example `walk`.
    pub name: String,
    /// Wall time [s].
    pub seconds: f64,
}

impl Report {
    /// The report as indented JSON with a final line break. `path` is where it will go, for messages.
    ///
    /// # Errors
    /// If it cannot be expressed in JSON.
    pub fn to_json(&self, path: &Path) -> Result<Vec<u8>, Error> {
        let mut bytes = serde_json::to_vec_pretty(self).map_err(|e| Error::invalid(path, e.to_string()))?;
        bytes.push(b'\n');
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keys of an object in order, nested ones in braces.
    fn keys(value: &serde_json::Value) -> String {
        match value {
            serde_json::Value::Object(map) => {
                let mut all: Vec<String> = map.iter().map(|(k, v)| format!("{k}{}", keys(v))).collect();
                all.sort();
                format!("{{{}}}", all.join(","))
            }
            serde_json::Value::Array(items) => items.first().map_or(String::new(), |v| format!("[{}]", keys(v))),
            _ => String::new(),
        }
    }

    #[test]
    fn the_keys_are_the_contract() {
        let report = Report {
            refinement: Refinement { passes: vec![Pass::default()], ..Refinement::default() },
            light_groups: vec![LightGroup { name: String::new(), files: vec![String::new()] }],
            directional: vec![DirectionalTexture { name: String::new(), files: vec![String::new()] }],
            contacts: Some(Contacts::default()),
            treated: vec![Treated::default()],
            vertices: Some(Vertices::default()),
            stages: vec![Stage::default()],
            warnings: vec![Warning::new("some-code", "text").at("node 3")],
            ..Report::default()
        };
        let bytes = report.to_json(Path::new("r.json")).unwrap();
        let value: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
        assert_eq!(
            keys(&value),
            "{atlas{charts,mip_levels,page_size[],pages,texels,utilization},contacts{lines_continued,triangles_cut,triangles_made},\
             directional[{files[],name}],error{estimated_nrmse,estimated_nrmse_99},gather{rays,rays_per_texel},\
             inputs,light_groups[{files[],name}],outputs,peak_memory_bytes,rays,rays_per_second,\
             refinement{ended_by,passes[{budget,estimated_nrmse,seconds}],target_error,time_limit},scene{instances,lights,materials,triangles},schema,seams{points,step,step_before,worst,worst_at[]},\
             settings{},stages[{name,seconds}],treated[{casts,density,emission,light_group,mesh[],node,receives}],version,vertices{averaged_nrmse,fit_nrmse,sampled_nrmse,triangles,unknowns,vertices},walk{bounces,lines,power_absorbed[],power_escaped[],power_in[],\
             power_residual[]},warnings[{code,message,node}]}"
        );
    }
}
