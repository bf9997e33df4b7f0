//! Gives every corner its output vertex: one per (source vertex, chart), in the order of first use.

use super::Atlas;
use super::Chart;
use super::ChartedPart;
use super::NO_CHART;
use super::arrange::Arranged;
use crate::base::parallel;
use crate::scene::Scene;
use core::iter::repeat;
use glam::Vec2;
use std::collections::HashMap;

/// A triangle's chart and the positions of its corners [texels].
type Placed = (u32, [Vec2; 3]);

/// The finished atlas.
pub(super) fn assemble(scene: &Scene, arranged: &Arranged, kept: &[bool]) -> Atlas {
    let mut charts = Vec::new();
    let mut placed: Vec<Vec<Option<Placed>>> =
        scene.parts.iter().map(|part| vec![None; if part.receives { part.triangles.len() } else { 0 }]).collect();
    let step = 1.0 / (1u32 << arranged.fraction_bits) as f32;
    for block in &arranged.blocks {
        let first = charts.len() as u32;
        charts.extend(block.piece.parts.iter().map(|part| Chart { part: *part, page: block.place.page }));
        let origin = Vec2::new(block.place.x as f32, block.place.y as f32);
        for (face, grid) in block.piece.faces.iter().zip(&block.shape.grid) {
            let uv = grid.map(|p| origin + Vec2::new(p[0] as f32, p[1] as f32) * step);
            placed[face.part as usize][face.triangle as usize] = Some((first + face.chart, uv));
        }
    }
    let parts = parallel::map(scene.parts.len(), |p| charted_part(scene, p, &placed[p], kept[p]));
    Atlas {
        page_size: arranged.page_size,
        pages: arranged.pages,
        texels_per_meter: arranged.texels_per_meter,
        charts,
        parts,
        covered_texels: arranged.blocks.iter().map(|block| block.shape.footprint.texels).sum(),
        mips: arranged.mips,
    }
}

fn charted_part(scene: &Scene, p: usize, placed: &[Option<Placed>], kept: bool) -> ChartedPart {
    let part = &scene.parts[p];
    let mut charted = ChartedPart { kept, ..ChartedPart::default() };
    if scene.is_copied(p) && !part.receives {
        return charted;
    }
    let identity = kept || !part.receives;
    if identity {
        charted.source_vertex = (0..part.vertices.len() as u32).collect();
        charted.uv = vec![Vec2::ZERO; part.vertices.len()];
    }
    let mut index: HashMap<(u32, u32), u32> = HashMap::new();
    for (triangle, placed) in scene.part_triangles(part).zip(placed.iter().copied().chain(repeat(None))) {
        let (chart, uv) = placed.unwrap_or((NO_CHART, [Vec2::ZERO; 3]));
        let mut vertices = triangle;
        for k in 0..3 {
            let source = triangle[k];
            if !identity {
                vertices[k] = *index.entry((source, chart)).or_insert_with(|| {
                    charted.source_vertex.push(source);
                    charted.uv.push(uv[k]);
                    (charted.uv.len() - 1) as u32
                });
            } else if chart != NO_CHART {
                charted.uv[source as usize] = uv[k];
            }
        }
        charted.triangles.push(vertices);
        charted.chart.push(chart);
    }
    charted
}
