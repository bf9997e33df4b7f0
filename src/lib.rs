//! texelwalk bakes diffuse global illumination into lightmaps or vertex colours for glTF assets, headless and
//! reproducible.
//!
//! # The pipeline
//!
//! ```text
//! scene ─► (contacts) ─► atlas ─► patches ─► light ─► walk ─► gather ─► finish ─► seams ─► (vertices) ─► output ─► (html)
//! glTF     cuts where    xatlas    texels     direct   fuzzy    last      sharing   both      least        EXR, glTF,  page for
//!          things stand  charts    + links    light    random   bounce    dilation  sides     squares      PNG, report people
//!                                                      walk     per texel            agree
//! ```
//!
//! [`bake`] runs it and is the only code that names every stage. [`scene`] reads a glTF into world-space triangles;
//! after it nothing is optional. [`trace`] answers what a ray meets. [`contacts`] cuts triangles along the foot of what
//! stands on them, where that is asked for. [`atlas`] gives every surface a place on a
//! lightmap page. [`patches`] makes every texel that a triangle touches a patch, and links neighbours that see each
//! other. [`light`] finds direct light, [`walk`] all bounces, [`mod@gather`] the last bounce once more per texel.
//! [`finish`] shares noisy light between neighbours, and fills pages beyond their charts; [`seams`] makes the two sides of
//! borders between charts agree. [`vertices`] fits light at the
//! vertices to the pages, where that is what is wanted. [`output`] turns results into bytes
//! and puts them on the disk together; [`html`] is a page about the bake for people. [`memory`] says what a bake takes
//! of it. [`mod@inspect`], [`mod@compare`], [`mod@render`] and [`mod@check`] look at inputs and results. [`settings`]
//! says what the options of [`cli`] mean.
//!
//! # Units
//!
//! | quantity | symbol | unit | where |
//! |---|---|---|---|
//! | position, distance | p, d | m | everywhere |
//! | flux | Φ = A·E | lm | `walk` |
//! | irradiance | E | lx = lm/m² | `light`, `walk`, `gather` |
//! | radiance | L | cd/m² | emission, sky, environment; stored lightmap E/π |
//! | intensity | I | cd | point and spot lights: E = I·cos θ/d² |
//! | illuminance of a sun | | lx | E = I·cos θ |
//! | reflectance | ρ = base colour·(1 − metallic) | 1 | `patches`; a patch sends out ρ·E/π; with glass and sheets see `scene` (`optics`) |
//!
//! Colours are linear Rec.709. There is no hidden factor between any two of these.
//!
//! # Invariants
//!
//! * **Invariant:** the same input, options and version give the same bytes at any thread count. Random numbers are
//!   hashes of what they are for; flux is summed in fixed point; sums of floats run over fixed chunks in order;
//!   transcendental functions come from `libm`; no fused multiply-add has a part in a result.
//! * **Invariant:** only `scene` and `output` touch the file system, but for `render` reading lightmap pages through
//!   them. Outputs appear together or not at all; an input is never overwritten.
//! * **Invariant:** numeric stages return values and cannot fail; I/O stages have one error type each.
//! * **Invariant:** no global state, no printing. What is odd becomes a [`base::Warning`].
//! * **Invariant:** `walk` and `gather` know no file, material or light: a tracer, patches and flux are all they get.
//!
//! Which folder may name which other one is a table in `tests/tidy.rs`.
//!
//! # Glossary
//!
//! * *texel*: a cell of a lightmap page. *patch*: the surface in one texel, on one side; the unit of the solver.
//! * *exposed*: the part of a patch that does not lie inside a solid. *link*: two patches between which light may be
//!   shared. *line*: a ray that carries flux. *splat*: what a line gives to neighbours of the patch it hits.
//! * *share*: flow of light along links, reversible, so that constant light stays constant.
//! * *light vector*: how irradiance changes with the normal, as far as a linear function tells; what directional
//!   lightmaps hold.
//! * *halves*: two solutions that share no random number; their difference is the error estimate.
//!
//! # Absent on purpose
//!
//! GPU code, a window, specular light, a denoiser that does not know where light comes from, and defaults that depend
//! on the machine.
//!
//! # Bibliography
//!
//! * F. Castro, M. Feixas, M. Sbert: "Fuzzy Random Walk". Universitat de Girona, 2002. The walk and its splat.
//! * P. Bekaert: "Hierarchical and Stochastic Algorithms for Radiosity". doctoral thesis, KU Leuven, 1999. Shooting.
//! * A. Conty Estevez, C. Kulla: "Importance Sampling of Many Lights with Adaptive Tree Splitting". HPG 2018. Many
//!   lights.
//! * O. Karlík, M. Šik, P. Vévoda, T. Skřivan, J. Křivánek: "MIS Compensation". SIGGRAPH Asia 2019. Environment maps.
//! * J. Arvo: "Stratified Sampling of Spherical Triangles". SIGGRAPH 1995. Emissive surfaces.
//! * J. Hanika: "Hacking the Shadow Terminator". Ray Tracing Gems II, 2021. Smooth bodies made of facets.
//! * F. Rousselle, M. Manzi, M. Zwicker: "Robust Denoising using Feature and Color Information". CGF 32(7), 2013. Two
//!   buffers that judge each other: how far light is shared.
//! * A. Ahmed, P. Wonka: "Screen-space Blue-noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of
//!   Pixels". ACM TOG 39(6), 2020. Points along a Z-order curve.
//! * B. Burley: "Practical Hash-based Owen Scrambling". JCGT 9(4), 2020. Low-discrepancy points.
//! * L. Kavan, A. W. Bargteil, P.-P. Sloan: "Least Squares Vertex Baking". EGSR 2011. Light at vertices.
//! * S. Woop, C. Benthin, I. Wald: "Watertight Ray/Triangle Intersection". JCGT 2(1), 2013.
//! * Khronos Group: glTF 2.0 specification and the extension `KHR_lights_punctual`. Units and falloff.

pub mod atlas;
pub mod bake;
pub mod base;
pub mod check;
pub mod cli;
pub mod compare;
pub mod contacts;
pub mod finish;
pub mod gather;
pub mod html;
pub mod inspect;
pub mod light;
pub mod memory;
pub mod output;
pub mod patches;
pub mod render;
pub mod scene;
pub mod seams;
pub mod settings;
pub mod trace;
pub mod vertices;
pub mod walk;
