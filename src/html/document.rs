//! Puts pictures and figures into the template.

use super::maps::{DIM, MOST_MAPS, MapPictures};
use super::markup::{count, escaped, filled, measured, percent, picture, seconds, significant, size};
use super::views::{MOST_VIEWS, ViewPictures};
use super::{Image, Pictures, tables};
use crate::output::report::Report;
use tables::section;

const TEMPLATE: &str = include_str!("template.html");
const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("slider.js");

/// A setting that is not the preset's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Change {
    /// Long option name.
    pub option: String,
    /// What it is.
    pub value: String,
    /// What it is in the preset.
    pub preset: String,
}

/// What the report does not say.
#[derive(Debug, Clone, Copy)]
pub struct Facts<'a> {
    /// Name of the scene.
    pub title: &'a str,
    /// Name of the preset.
    pub preset: &'a str,
    /// In the order of the options.
    pub changes: &'a [Change],
    /// What was reached [texels/m].
    pub texels_per_meter: f32,
    /// Names and sizes [bytes] of the other files.
    pub files: &'a [(String, u64)],
}

/// The page.
#[must_use]
pub fn page(pictures: &Pictures, report: &Report, facts: &Facts<'_>) -> Vec<u8> {
    let title = escaped(facts.title);
    let lead = lead(report, facts);
    let (facts_html, main) = (tiles(report, facts), sections(pictures, report, facts));
    let values = [
        ("title", title.as_str()),
        ("style", STYLE),
        ("script", SCRIPT),
        ("lead", &lead),
        ("facts", &facts_html),
        ("main", &main),
        ("version", &escaped(&report.version)),
    ];
    filled(TEMPLATE, &values).into_bytes()
}

fn lead(report: &Report, facts: &Facts<'_>) -> String {
    let target = if report.vertices.is_some() { "Light at vertices" } else { "Lightmap" };
    let warnings = match report.warnings.len() {
        0 => "no warnings".to_owned(),
        1 => "<a href=\"#warnings\">1 warning</a>".to_owned(),
        n => format!("<a href=\"#warnings\">{n} warnings</a>"),
    };
    let changed = match facts.changes.len() {
        0 => String::new(),
        n => format!(" with <a href=\"#settings\">{n} changed option{}</a>", if n == 1 { "" } else { "s" }),
    };
    let triangles = count(report.scene.triangles);
    format!("{target} for {triangles} triangles, preset <b>{}</b>{changed}, {warnings}", escaped(facts.preset))
}

fn tiles(report: &Report, facts: &Facts<'_>) -> String {
    let atlas = &report.atlas;
    let [width, height] = atlas.page_size;
    let density = significant(f64::from(facts.texels_per_meter), 3);
    let error = report.error.estimated_nrmse.map_or("–".to_owned(), percent);
    let memory = if report.peak_memory_bytes == 0 { "–".to_owned() } else { size(report.peak_memory_bytes) };
    let used = format!("{} of the pages", percent(atlas.utilization));
    let rays = format!("{} rays", count(report.rays));
    let pages = format!("{width} × {height}, {} charts", count(atlas.charts));
    let all = [
        ("Stated error", error, "of the mean light".to_owned()),
        ("Texels", count(atlas.texels), used),
        ("Pages", count(u64::from(atlas.pages)), pages),
        ("Density", density, "texels per metre".to_owned()),
        ("Time", measured(&seconds(tables::total(report))), rays),
        ("Peak memory", measured(&memory), "largest resident set".to_owned()),
    ];
    // Vertex light has no pages to speak of.
    let shown = all.into_iter().filter(|(name, ..)| report.vertices.is_none() || *name != "Pages");
    let tile = |(name, value, note): (&str, String, String)| {
        let note = if report.vertices.is_some() && name == "Texels" { "solved, not written".to_owned() } else { note };
        format!("<div><dt>{name}</dt><dd>{value}</dd><dd class=\"note\">{note}</dd></div>\n")
    };
    shown.map(tile).collect()
}

fn sections(pictures: &Pictures, report: &Report, facts: &Facts<'_>) -> String {
    let mut out = views(pictures);
    if !report.warnings.is_empty() {
        out += &section("warnings", "Warnings", &tables::warnings(&report.warnings));
    }
    if !pictures.maps.pages.is_empty() {
        out += &maps(pictures, report.atlas.pages);
    }
    if !pictures.groups.is_empty() {
        out += &section("groups", "Light groups", &tables::groups(&pictures.groups));
    }
    if let Some(fit) = &report.vertices {
        out += &section("vertices", "Light at vertices", &tables::vertices(fit));
    }
    out += &section("stages", "Time", &tables::stages(report));
    out += &section("passes", "Passes", &tables::passes(report));
    out += &section("ledger", "Power of the walk", &tables::ledger(&report.walk));
    out += &section("settings", "Settings", &tables::changes(facts));
    out += &section("files", "Files", &tables::files(facts));
    out
}

fn views(pictures: &Pictures) -> String {
    let density = tables::legend(
        "Density of texels on surfaces; squares are single texels. Shares are of all texels.",
        &pictures.maps.density,
    );
    let all: String = pictures.views.iter().enumerate().map(|(k, view)| one_view(k, view, &density)).collect();
    let more = match pictures.cameras.saturating_sub(MOST_VIEWS) {
        0 => String::new(),
        n => format!("<p class=\"note\">The document has {n} more cameras.</p>\n"),
    };
    section("views", "Without and with the bake", &(all + &more))
}

/// A picture to choose among several of the same thing.
struct Choice {
    name: &'static str,
    /// A stack of elements.
    html: String,
    /// It is drawn over the first one.
    over: bool,
}

fn one_view(k: usize, view: &ViewPictures, density: &str) -> String {
    let ViewPictures { camera, exposure, baked, plain, texels } = view;
    let compare = format!(
        "<div class=\"compare\">{}{}<span class=\"tag left\">without</span><span class=\"tag right\">with the bake</span>\
         <span class=\"line\"></span><input type=\"range\" min=\"0\" max=\"100\" value=\"50\" step=\"0.5\" autocomplete=\"off\" aria-label=\"Part of the \
         picture that is shown without the bake, in percent\"></div>",
        picture(baked, "", "The scene in the light that was baked"),
        picture(plain, "without", "The scene without a bake: base colour under a lamp at the camera"),
    );
    let choice = |name, html| Choice { name, html, over: false };
    let mut choices = vec![choice("Light", compare)];
    if let Some([charts, density_image]) = texels {
        choices.push(choice("Charts", alone(charts, "The charts of the scene, a colour for each", "")));
        choices.push(choice("Density", alone(density_image, "The density of texels on the scene", density)));
    }
    let camera = escaped(camera);
    let caption = format!("Camera <b>{camera}</b>, exposure {exposure:+.2} stops");
    chooser(&format!("view{k}"), &choices, &caption)
}

fn alone(image: &Image, alt: &str, legend: &str) -> String {
    format!("{}{legend}", picture(image, "", alt))
}

fn chooser(id: &str, choices: &[Choice], caption: &str) -> String {
    let (mut inputs, mut layers) = (String::new(), String::new());
    for (k, Choice { name, html, over }) in choices.iter().enumerate() {
        let checked = if k == 0 { " checked" } else { "" };
        inputs += &format!(
            "<input type=\"radio\" class=\"pick{k}\" name=\"{id}\" id=\"{id}-{k}\"{checked}><label for=\"{id}-{k}\">{name}</label>\n"
        );
        let class = if *over { " over" } else { "" };
        layers += &format!("<div class=\"layer layer{k}{class}\">{html}</div>\n");
    }
    let single = if choices.len() < 2 { " single" } else { "" };
    format!(
        "<figure class=\"chooser{single}\">\n{inputs}<div class=\"stack\">\n{layers}</div>\n<figcaption>{caption}</figcaption>\n</figure>\n"
    )
}

fn maps(pictures: &Pictures, pages: u32) -> String {
    let density = tables::legend("Density of texels. Shares are of all texels.", &pictures.maps.density);
    let dim = significant(f64::from(DIM) * 100.0, 2);
    let noise = tables::legend(
        &format!(
            "Standard error of a texel as a part of its own light, or of {dim} % of the mean light where it is darker. \
             Shares are of all texels."
        ),
        &pictures.maps.noise,
    );
    let one = |(k, map): (usize, &MapPictures)| {
        let choice = |name, html| Choice { name, html, over: false };
        let choices = [
            choice("Light", alone(&map.light, &format!("Lightmap page {k}"), "")),
            Choice { name: "Charts", html: alone(&map.charts, "Its charts, a colour for each", ""), over: true },
            choice("Density", alone(&map.density, "Density of its texels", &density)),
            choice("Error", alone(&map.noise, "Standard error of its texels", &noise)),
        ];
        let scale = match map.texels_per_pixel {
            1 => String::new(),
            n => format!(", a pixel shows {n} × {n} texels"),
        };
        chooser(&format!("page{k}"), &choices, &format!("Page {k}{scale}"))
    };
    let all: String = pictures.maps.pages.iter().enumerate().map(one).collect();
    let grid = if pictures.maps.pages.len() > 1 { format!("<div class=\"grid\">\n{all}</div>\n") } else { all };
    let more = match (pages as usize).saturating_sub(MOST_MAPS) {
        0 => String::new(),
        n => format!("<p class=\"note\">There are {n} more pages.</p>\n"),
    };
    section("pages", "Lightmap pages", &(grid + &more))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_is_filled_and_text_is_escaped() {
        let facts = Facts { title: "<script>{{main}}", preset: "p", changes: &[], texels_per_meter: 1.0, files: &[] };
        let html = String::from_utf8(page(&Pictures::default(), &Report::default(), &facts)).unwrap();
        assert!(html.contains("<title>&lt;script&gt;{{main}}"));
        assert_eq!(html.matches("{{").count(), html.matches("{{main}}").count());
        assert!(!TEMPLATE.is_empty() && !STYLE.contains("{{") && !SCRIPT.contains("{{"));
    }
}
