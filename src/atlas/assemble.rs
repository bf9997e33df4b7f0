//! Gives every corner its output vertex: one per source vertex, chart and place, in the order of first use. Places differ
//! within a chart where it is several that share a texel.
//!
//! Charts are numbered by part; those of a part are neighbours, in the order of its blocks. In a kept layout of several
//! parts they are those of the block.

use super::Atlas;
use super::Chart;
use super::ChartedPart;
use super::NO_CHART;
use super::align::Face;
use super::arrange::Arranged;
use super::arrange::Block;
use super::layout::Layout;
use crate::base::parallel;
use crate::scene::Scene;
use core::iter::repeat;
use glam::Vec2;
use std::collections::HashMap;
use std::sync::Arc;

/// A triangle's chart among those of its part, and the positions of its corners [texels], see [`Layout::uv`].
type Corners = (u32, [Vec2; 3]);

/// A block with charts of a part.
#[derive(Clone, Copy)]
struct Laid<'a> {
    block: &'a Block,
    /// Which of the block's places.
    copy: usize,
    /// Index into `Atlas::charts` of the block's first chart.
    first: u32,
    /// The part in the entry of `Piece::owners`.
    member: u32,
}

/// The finished atlas.
pub(super) fn assemble(scene: &Scene, arranged: &Arranged, kept: &[bool]) -> Atlas {
    let mut order: Vec<(u32, usize, usize)> = Vec::new();
    for (b, block) in arranged.blocks.iter().enumerate() {
        order.extend(block.piece.owners.iter().enumerate().map(|(copy, parts)| (parts[0], b, copy)));
    }
    order.sort_unstable();
    let mut charts = Vec::new();
    let mut laid: Vec<Vec<Laid<'_>>> = vec![Vec::new(); scene.parts.len()];
    for (_, b, copy) in order {
        let block = &arranged.blocks[b];
        let (owners, page) = (&block.piece.owners[copy], block.places[copy].page);
        for (member, part) in (0..).zip(owners) {
            laid[*part as usize].push(Laid { block, copy, first: charts.len() as u32, member });
        }
        charts.extend(block.piece.parts.iter().map(|member| Chart { part: owners[*member as usize], page }));
    }
    let leads = |p: usize| laid[p].first().is_none_or(|laid| laid.copy == 0);
    let bits = arranged.fraction_bits;
    let layout = |p: usize| leads(p).then(|| Arc::new(layout(scene, p, &laid[p], kept[p], bits)));
    let layouts = parallel::map(scene.parts.len(), layout);
    let part = |p: usize| {
        let leader = laid[p].first().map_or(p, |laid| laid.block.piece.owners[0][laid.member as usize] as usize);
        ChartedPart {
            layout: layouts[leader].clone().unwrap_or_default(),
            first_chart: laid[p].first().map_or(0, |laid| laid.first),
            places: laid[p].iter().flat_map(Laid::places).collect(),
            kept: kept[p],
        }
    };
    let covered = |block: &Block| block.shape.footprint.texels * block.places.len() as u64;
    Atlas {
        page_size: arranged.page_size,
        pages: arranged.pages,
        texels_per_meter: arranged.texels_per_meter,
        charts,
        parts: (0..scene.parts.len()).map(part).collect(),
        covered_texels: arranged.blocks.iter().map(covered).sum(),
        mips: arranged.mips,
    }
}

impl Laid<'_> {
    /// Where the block lies [texels].
    fn place(&self) -> Vec2 {
        let place = self.block.places[self.copy];
        Vec2::new(place.x as f32, place.y as f32)
    }

    /// Whether it is a kept layout that no other parts share. Its layouts hold positions on the page: a place for each chart
    /// of the block in each of its parts would be the square of them.
    fn is_on_page(&self) -> bool {
        self.block.piece.page.is_some() && self.block.places.len() == 1
    }

    /// Places of the charts of the block, unless its layouts hold them [texels].
    fn places(&self) -> impl Iterator<Item = Vec2> + use<> {
        let count = if self.is_on_page() { 0 } else { self.block.piece.parts.len() };
        core::iter::repeat_n(self.place(), count)
    }

    /// Its faces of the part, with their corners; in the order of parts, they are a range.
    fn faces(&self) -> impl Iterator<Item = (&Face, &[[i32; 2]; 3])> {
        let (faces, grid) = (&self.block.piece.faces, &self.block.shape.grid);
        let until = |member: u32| faces.partition_point(|face| face.part < member);
        let range = until(self.member)..until(self.member + 1);
        faces[range.clone()].iter().zip(&grid[range])
    }
}

fn layout(scene: &Scene, p: usize, laid: &[Laid<'_>], kept: bool, bits: u32) -> Layout {
    let part = &scene.parts[p];
    let mut layout = Layout::default();
    if scene.is_copied(p) && !part.receives {
        return layout;
    }
    let identity = kept || !part.receives;
    if identity {
        layout.source_vertex = (0..part.vertices.len() as u32).collect();
        layout.uv = vec![Vec2::ZERO; part.vertices.len()];
        layout.vertex_chart = vec![NO_CHART; part.vertices.len()];
    }
    let mut index: HashMap<(u32, u32, [u32; 2]), u32> = HashMap::new();
    let placed = placed(if part.receives { part.triangles.len() } else { 0 }, laid, bits);
    for (triangle, placed) in scene.part_triangles(part).zip(placed.into_iter().chain(repeat(None))) {
        let (chart, uv) = placed.unwrap_or((NO_CHART, [Vec2::ZERO; 3]));
        let mut vertices = triangle;
        for k in 0..3 {
            let source = triangle[k];
            if !identity {
                vertices[k] = *index.entry((source, chart, uv[k].to_array().map(f32::to_bits))).or_insert_with(|| {
                    layout.source_vertex.push(source);
                    layout.uv.push(uv[k]);
                    layout.vertex_chart.push(chart);
                    (layout.uv.len() - 1) as u32
                });
            } else if chart != NO_CHART {
                (layout.uv[source as usize], layout.vertex_chart[source as usize]) = (uv[k], chart);
            }
        }
        layout.triangles.push(vertices);
        layout.chart.push(chart);
    }
    layout
}

/// For each triangle of a part, its chart and place.
fn placed(triangles: usize, laid: &[Laid<'_>], bits: u32) -> Vec<Option<Corners>> {
    let step = 1.0 / (1u32 << bits) as f32;
    let mut placed = vec![None; triangles];
    let mut first = 0;
    for laid in laid {
        let place = if laid.is_on_page() { laid.place() } else { Vec2::ZERO };
        for (face, grid) in laid.faces() {
            let uv = grid.map(|p| Vec2::new(p[0] as f32, p[1] as f32) * step + place);
            placed[face.triangle as usize] = Some((first + face.chart, uv));
        }
        first += laid.block.piece.parts.len() as u32;
    }
    placed
}
