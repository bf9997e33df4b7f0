//! What a surface is like at a point of a triangle.
//!
//! A point is given by `b = (b1, b2)`, the barycentric weights of the triangle's vertices 1 and 2.

use super::{Alpha, Material, Part, Scene, TextureRef, Treatment};
use crate::base::Rgb;
use glam::{Vec2, Vec3, Vec4};

impl Scene {
    /// World position [m].
    #[must_use]
    pub fn position(&self, triangle: u32, b: Vec2) -> Vec3 {
        mix(self.corners(triangle), b)
    }

    /// Area [m²].
    #[must_use]
    pub fn area(&self, triangle: u32) -> f64 {
        let [p0, p1, p2] = self.corners(triangle).map(|p| p.as_dvec3());
        0.5 * (p1 - p0).cross(p2 - p0).length()
    }

    /// Unit normal of the triangle's front side; zero for a triangle without area.
    #[must_use]
    pub fn geometric_normal(&self, triangle: u32) -> Vec3 {
        let [p0, p1, p2] = self.corners(triangle).map(|p| p.as_dvec3());
        (p1 - p0).cross(p2 - p0).normalize_or_zero().as_vec3()
    }

    /// Interpolated unit normal, on the front side of the triangle.
    #[must_use]
    pub fn shading_normal(&self, triangle: u32, b: Vec2) -> Vec3 {
        self.shading_normal_over(triangle, b, self.geometric_normal(triangle))
    }

    /// The same, where the geometric normal is known.
    #[must_use]
    pub fn shading_normal_over(&self, triangle: u32, b: Vec2, geometric: Vec3) -> Vec3 {
        if self.part(triangle).flat {
            return geometric;
        }
        let n = mix(self.corner_normals(triangle), b);
        let n = n.normalize_or_zero();
        if n.dot(geometric) > 0.0 { n } else { geometric }
    }

    /// A part has vertices that its document lacks, or edges over which no chart may go.
    #[must_use]
    pub fn is_cut(&self, part: usize) -> bool {
        let vertices = &self.parts[part].vertices;
        let first = self.cuts.borders.partition_point(|b| b[0] < vertices.start);
        let bordered = self.cuts.borders.get(first).is_some_and(|b| b[0] < vertices.end);
        bordered || self.cuts.origins_of(part).is_some()
    }

    /// Name of a node that places parts; empty for others.
    #[must_use]
    pub fn node_name(&self, node: usize) -> &str {
        self.parts.iter().find(|p| p.node == node).map_or("", |p| p.name.as_str())
    }

    /// The part that a triangle belongs to.
    #[must_use]
    pub fn part(&self, triangle: u32) -> &Part {
        &self.parts[self.part_index(triangle)]
    }

    /// The material of a triangle.
    #[must_use]
    pub fn material(&self, triangle: u32) -> &Material {
        &self.materials[self.part(triangle).material]
    }

    /// Diffuse reflectance ρ = base colour · (1 − metallic), in [0, 1], of what the surface stops (see
    /// [`Scene::opacity`]); 0 for unlit materials.
    #[must_use]
    pub fn reflectance(&self, triangle: u32, b: Vec2) -> Rgb {
        let material = self.material(triangle);
        if material.unlit {
            return Rgb::ZERO;
        }
        if let Some(r) = &material.diffuse_texture {
            let texel = self.textures[r.texture].sample_srgb(self.texture_uv(triangle, b, r)).truncate();
            let color = self.color_factor(material, triangle, b).truncate() * texel;
            return color.clamp(Rgb::ZERO, Rgb::ONE);
        }
        let base = self.base_color(triangle, b).truncate();
        self.scattered(material, triangle, b, base * (1.0 - self.translucence(material, triangle, b)))
    }

    /// The same for what leaves on the other side.
    #[must_use]
    pub fn diffuse_transmittance(&self, triangle: u32, b: Vec2) -> Rgb {
        let material = self.material(triangle);
        let Some(through) = &material.translucency else { return Rgb::ZERO };
        let texel = |r: &TextureRef| self.textures[r.texture].sample_srgb(self.texture_uv(triangle, b, r)).truncate();
        let color = through.color_texture.as_ref().map_or(through.color, |r| through.color * texel(r));
        self.scattered(material, triangle, b, color * self.translucence(material, triangle, b))
    }

    /// A diffuse colour, less what is reflected as by a mirror and what passes, for what the surface stops.
    fn scattered(&self, material: &Material, triangle: u32, b: Vec2, mut color: Rgb) -> Rgb {
        if let Some(r) = &material.specular_texture {
            let texel = self.textures[r.texture].sample_srgb(self.texture_uv(triangle, b, r)).truncate();
            color *= 1.0 - (material.specular * texel).max_element();
        }
        let all = (color * (1.0 - self.metallic(material, triangle, b))).clamp(Rgb::ZERO, Rgb::ONE);
        if material.transmission == 0.0 {
            return all;
        }
        let scattered = self.coverage(material, triangle, b) * (1.0 - self.passing(material, triangle, b));
        let stopped = self.opacity(triangle, b);
        if stopped > 0.0 { (all * (scattered / stopped)).min(Rgb::ONE) } else { Rgb::ZERO }
    }

    /// Share of the scattered light that leaves on the other side.
    fn translucence(&self, material: &Material, triangle: u32, b: Vec2) -> f32 {
        let Some(through) = &material.translucency else { return 0.0 };
        let texel = |r: &TextureRef| self.textures[r.texture].sample_alpha(self.texture_uv(triangle, b, r));
        through.factor_texture.as_ref().map_or(through.factor, |r| through.factor * texel(r))
    }

    fn metallic(&self, material: &Material, triangle: u32, b: Vec2) -> f32 {
        let texel = |r: &TextureRef| self.textures[r.texture].sample_linear(self.texture_uv(triangle, b, r)).z;
        material.metallic_texture.as_ref().map_or(material.metallic, |r| material.metallic * texel(r))
    }

    /// Share of the light that `KHR_materials_transmission` lets pass, before its colour.
    fn passing(&self, material: &Material, triangle: u32, b: Vec2) -> f32 {
        let texel = |r: &TextureRef| self.textures[r.texture].sample_linear(self.texture_uv(triangle, b, r)).x;
        material.transmission_texture.as_ref().map_or(material.transmission, |r| material.transmission * texel(r))
    }

    /// Emitted radiance of the front side [cd/m²] (both sides of a double-sided material), as others are lit by it: what
    /// alpha leaves of the surface glows.
    #[must_use]
    pub fn emission(&self, triangle: u32, b: Vec2) -> Rgb {
        let Treatment { casts, emission, .. } = self.part(triangle).treatment;
        let material = self.material(triangle);
        if !(casts && material.glows()) {
            return Rgb::ZERO;
        }
        self.glow(material, triangle, b) * (emission * self.coverage(material, triangle, b))
    }

    /// The same without textures: no point of the triangle emits more [cd/m²].
    #[must_use]
    pub fn most_emission(&self, triangle: u32) -> Rgb {
        self.material(triangle).emission * self.part(triangle).treatment.emission
    }

    /// The texture of what a triangle emits, and its coordinates at three points of it; `None` without one.
    #[must_use]
    pub fn emission_uvs(&self, triangle: u32, b: [Vec2; 3]) -> Option<(usize, [Vec2; 3])> {
        let r = self.material(triangle).emission_texture.as_ref()?;
        Some((r.texture, b.map(|b| self.texture_uv(triangle, b, r))))
    }

    /// Emitted radiance as the document has it, which is what can be seen [cd/m²], of what the surface stops (see
    /// [`Scene::opacity`]).
    #[must_use]
    pub fn shown_emission(&self, triangle: u32, b: Vec2) -> Rgb {
        let material = self.material(triangle);
        if !material.glows() {
            return Rgb::ZERO;
        }
        let glow = self.glow(material, triangle, b);
        if material.transmission == 0.0 {
            return glow;
        }
        let stopped = self.opacity(triangle, b);
        if stopped > 0.0 { glow * (self.coverage(material, triangle, b) / stopped) } else { Rgb::ZERO }
    }

    /// What a point that exists emits [cd/m²].
    fn glow(&self, material: &Material, triangle: u32, b: Vec2) -> Rgb {
        let texel = |r: &TextureRef| self.textures[r.texture].sample_srgb(self.texture_uv(triangle, b, r)).truncate();
        material.emission_texture.as_ref().map_or(material.emission, |r| material.emission * texel(r))
    }

    /// Probability in [0, 1] that the surface stops a ray at this point: 1 − the largest channel of
    /// [`Scene::transmittance`].
    #[must_use]
    pub fn opacity(&self, triangle: u32, b: Vec2) -> f32 {
        let material = self.material(triangle);
        if material.transmission == 0.0 {
            return self.coverage(material, triangle, b);
        }
        (1.0 - self.transmittance(triangle, b).max_element()).clamp(0.0, 1.0)
    }

    /// Share of the light in [0, 1] that goes straight through the surface at this point: past it, by its alpha, and
    /// through it, by `KHR_materials_transmission`. Only the latter has a colour.
    #[must_use]
    pub fn transmittance(&self, triangle: u32, b: Vec2) -> Rgb {
        let material = self.material(triangle);
        let coverage = self.coverage(material, triangle, b);
        let past = Rgb::splat(1.0 - coverage);
        if material.transmission == 0.0 {
            return past;
        }
        let through = self.passing(material, triangle, b) * (1.0 - self.metallic(material, triangle, b));
        let color = self.base_color(triangle, b).truncate().clamp(Rgb::ZERO, Rgb::ONE);
        past + color * (coverage * through)
    }

    /// Share of the light that a sheet with a volume leaves of what passes it at this point.
    #[must_use]
    pub fn sheet_transmittance(&self, triangle: u32, b: Vec2) -> Rgb {
        let Some(volume) = &self.material(triangle).volume else { return Rgb::ONE };
        let texel = |r: &TextureRef| self.textures[r.texture].sample_linear(self.texture_uv(triangle, b, r)).y;
        let thickness = volume.thickness_texture.as_ref().map_or(volume.thickness, |r| volume.thickness * texel(r));
        volume.left_after(thickness * self.part(triangle).scale)
    }

    /// What alpha leaves of the surface at this point, in [0, 1].
    fn coverage(&self, material: &Material, triangle: u32, b: Vec2) -> f32 {
        if material.alpha == Alpha::Opaque {
            return 1.0;
        }
        material.alpha.coverage(self.alpha(material, triangle, b))
    }

    /// The alpha of [`Scene::base_color`], without its colour: this is asked for at every hit of a masked surface.
    fn alpha(&self, material: &Material, triangle: u32, b: Vec2) -> f32 {
        let [a0, a1, a2] = self.stored_corners(triangle).0.map(|v| self.vertices.color[v as usize].w);
        // Exact where all three are equal: a cutoff may be that very value.
        let mut alpha = material.base_color.w * (a0 + (a1 - a0) * b.x + (a2 - a0) * b.y);
        if let Some(r) = &material.base_color_texture {
            alpha *= self.textures[r.texture].sample_alpha(self.texture_uv(triangle, b, r));
        }
        alpha
    }

    /// Base colour and alpha: factor × texture × vertex colour, linear.
    #[must_use]
    pub fn base_color(&self, triangle: u32, b: Vec2) -> Vec4 {
        let material = self.material(triangle);
        let mut color = self.color_factor(material, triangle, b);
        if let Some(r) = &material.base_color_texture {
            color *= self.textures[r.texture].sample_srgb(self.texture_uv(triangle, b, r));
        }
        color
    }

    /// Factor × vertex colour.
    fn color_factor(&self, material: &Material, triangle: u32, b: Vec2) -> Vec4 {
        let [c0, c1, c2] = self.stored_corners(triangle).0.map(|v| self.vertices.color[v as usize]);
        material.base_color * (c0 + (c1 - c0) * b.x + (c2 - c0) * b.y)
    }

    /// Coordinates of a texture at a point of a triangle.
    pub(super) fn texture_uv(&self, triangle: u32, b: Vec2, r: &TextureRef) -> Vec2 {
        let set = &self.vertices.uv[r.uv_set];
        let [a, c, d] = self.stored_corners(triangle).0.map(|v| set[v as usize]);
        r.transform.transform_point2(a + (c - a) * b.x + (d - a) * b.y)
    }

    /// Coordinates of a texture at the corners of a triangle.
    pub(super) fn corner_uvs(&self, triangle: u32, r: &TextureRef) -> [Vec2; 3] {
        let set = &self.vertices.uv[r.uv_set];
        self.stored_corners(triangle).0.map(|v| r.transform.transform_point2(set[v as usize]))
    }
}

fn mix(v: [Vec3; 3], b: Vec2) -> Vec3 {
    v[0] * (1.0 - b.x - b.y) + v[1] * b.x + v[2] * b.y
}
