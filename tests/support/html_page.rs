//! Reads the HTML that texelwalk writes, strictly: a subset of HTML5 in which every mistake is an error.
//!
//! In: a page. Out: its elements, and text, or the first fault. Rules beyond HTML5: tags are closed in the order in
//! which they were opened, attributes are quoted, ids are unique and what refers to one finds it, pictures have `alt`,
//! are data URIs, decode, and have the size that they state, and nothing refers to anything outside the page.
#![allow(dead_code, reason = "each test program uses a part")]
#![allow(unreachable_pub, reason = "shared by test programs")]

use base64::Engine;
use std::collections::{BTreeMap, BTreeSet};

const VOID: [&str; 4] = ["meta", "img", "input", "br"];

/// Words by which a page would reach for something else.
const REACHING: [&str; 9] =
    ["http:", "https:", "url(", "@import", "<link", "<iframe", "<base", "fetch(", "XMLHttpRequest"];

/// An element with the text directly inside it.
#[derive(Debug, Clone, Default)]
pub struct Element {
    pub tag: String,
    pub attributes: BTreeMap<String, String>,
    pub text: String,
}

/// A page.
#[derive(Debug, Default)]
pub struct Html {
    pub elements: Vec<Element>,
}

impl Element {
    pub fn is(&self, tag: &str, class: &str) -> bool {
        self.tag == tag && self.attributes.get("class").is_some_and(|c| c.split(' ').any(|c| c == class))
    }

    /// The picture of an `img`.
    pub fn picture(&self) -> Result<image::RgbImage, String> {
        let source = self.attributes.get("src").ok_or("img without src")?;
        let (mime, data) = source
            .strip_prefix("data:")
            .and_then(|s| s.split_once(";base64,"))
            .ok_or_else(|| format!("img: src is no data URI: {}", source.chars().take(40).collect::<String>()))?;
        let bytes = base64::engine::general_purpose::STANDARD.decode(data).map_err(|e| format!("img: {e}"))?;
        let format = image::ImageFormat::from_mime_type(mime).ok_or_else(|| format!("img: unknown type {mime}"))?;
        let picture = image::load_from_memory_with_format(&bytes, format).map_err(|e| format!("img: {e}"))?.into_rgb8();
        let stated = ["width", "height"].map(|a| self.attributes.get(a).and_then(|v| v.parse().ok()).unwrap_or(0));
        if [picture.width(), picture.height()] != stated {
            return Err(format!("img: states {stated:?}, is {:?}", picture.dimensions()));
        }
        Ok(picture)
    }
}

impl Html {
    /// All elements of a kind.
    pub fn all<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Element> {
        self.elements.iter().filter(move |e| e.tag == tag)
    }

    /// All text, in order of the elements that hold it.
    pub fn text(&self) -> String {
        self.elements.iter().map(|e| e.text.as_str()).collect::<Vec<_>>().join(" ")
    }

    /// The picture whose `alt` starts like this.
    pub fn picture(&self, alt: &str) -> image::RgbImage {
        let found = self.all("img").find(|e| e.attributes["alt"].starts_with(alt));
        found.unwrap_or_else(|| panic!("no picture {alt}")).picture().unwrap()
    }
}

/// Reads a page.
pub fn read(text: &str) -> Result<Html, String> {
    let mut rest = text.strip_prefix("<!DOCTYPE html>\n").ok_or("no doctype")?;
    let (mut html, mut open): (Html, Vec<usize>) = (Html::default(), vec![]);
    while !rest.is_empty() {
        let (before, after) = rest.split_once('<').unwrap_or((rest, ""));
        add_text(&mut html, &open, before)?;
        if before.len() == rest.len() {
            break;
        }
        if let Some(comment) = after.strip_prefix("!--") {
            rest = comment.split_once("-->").ok_or("a comment does not end")?.1;
        } else if let Some(close) = after.strip_prefix('/') {
            let (name, tail) = close.split_once('>').ok_or("a tag does not end")?;
            let opened = open.pop().ok_or_else(|| format!("</{name}> closes nothing"))?;
            if html.elements[opened].tag != name {
                return Err(format!("</{name}> closes <{}>", html.elements[opened].tag));
            }
            rest = tail;
        } else {
            let (element, tail) = tag(after)?;
            rest = tail;
            let name = element.tag.clone();
            html.elements.push(element);
            if ["style", "script"].contains(&name.as_str()) {
                let end = format!("</{name}>");
                rest = rest.split_once(&end).ok_or_else(|| format!("<{name}> does not end"))?.1;
            } else if !VOID.contains(&name.as_str()) {
                open.push(html.elements.len() - 1);
            }
        }
    }
    if let Some(&left) = open.last() {
        return Err(format!("<{}> is not closed", html.elements[left].tag));
    }
    check(text, &html)?;
    Ok(html)
}

fn add_text(html: &mut Html, open: &[usize], text: &str) -> Result<(), String> {
    if text.contains('>') {
        return Err(format!("a bare > in {text:?}"));
    }
    match open.last() {
        Some(&e) => html.elements[e].text += &unescaped(text)?,
        None if !text.trim().is_empty() => return Err(format!("text outside of everything: {text:?}")),
        None => {}
    }
    Ok(())
}

fn unescaped(text: &str) -> Result<String, String> {
    let known = [("lt;", '<'), ("gt;", '>'), ("amp;", '&'), ("quot;", '"'), ("#39;", '\'')];
    let mut parts = text.split('&');
    let mut out = parts.next().unwrap_or("").to_owned();
    for part in parts {
        let (name, c) = known.iter().find(|(n, _)| part.starts_with(n)).ok_or(format!("a bare & before {part:?}"))?;
        out.push(*c);
        out += &part[name.len()..];
    }
    match out.chars().find(|c| c.is_control() && *c != '\n') {
        Some(c) => Err(format!("control character {c:?}")),
        None => Ok(out),
    }
}

/// A tag from behind its `<`, and what follows its `>`.
fn tag(text: &str) -> Result<(Element, &str), String> {
    let end = text.find([' ', '>']).ok_or("a tag does not end")?;
    let mut element = Element { tag: text[..end].to_owned(), ..Element::default() };
    if element.tag.is_empty() || !element.tag.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit()) {
        return Err(format!("no tag: <{}", element.tag));
    }
    let mut rest = &text[end..];
    loop {
        rest = rest.trim_start();
        if let Some(tail) = rest.strip_prefix('>') {
            return Ok((element, tail));
        }
        let end = rest.find(['=', ' ', '>']).ok_or("a tag does not end")?;
        let name = rest[..end].to_owned();
        rest = &rest[end..];
        let mut value = String::new();
        if let Some(quoted) = rest.strip_prefix('=') {
            let quoted = quoted.strip_prefix('"').ok_or_else(|| format!("{name}: value without quotes"))?;
            let (inside, tail) = quoted.split_once('"').ok_or_else(|| format!("{name}: no end of quotes"))?;
            (value, rest) = (unescaped(inside)?, tail);
        }
        if name.is_empty() || element.attributes.insert(name.clone(), value).is_some() {
            return Err(format!("<{}>: attribute {name:?} twice or without name", element.tag));
        }
    }
}

fn check(text: &str, html: &Html) -> Result<(), String> {
    if let Some(word) = REACHING.iter().find(|word| text.contains(**word)) {
        return Err(format!("reaches outside: {word}"));
    }
    let ids: Vec<&String> = html.elements.iter().filter_map(|e| e.attributes.get("id")).collect();
    let unique: BTreeSet<&String> = ids.iter().copied().collect();
    if unique.len() != ids.len() {
        return Err("an id is there twice".to_owned());
    }
    for element in &html.elements {
        let reference = match element.tag.as_str() {
            "a" => element.attributes.get("href").map(|h| h.strip_prefix('#').unwrap_or("outside").to_owned()),
            "label" => element.attributes.get("for").cloned(),
            _ => None,
        };
        if let Some(id) = reference.filter(|id| !unique.contains(id)) {
            return Err(format!("<{}> refers to {id}, which is not there", element.tag));
        }
        if element.tag == "img" {
            if element.attributes.get("alt").is_none_or(String::is_empty) {
                return Err("img without alt".to_owned());
            }
            element.picture()?;
        } else if element.attributes.contains_key("src") || element.attributes.keys().any(|a| a.starts_with("on")) {
            return Err(format!("<{}> has src or a handler", element.tag));
        }
    }
    Ok(())
}

/// The page without what depends on the machine.
pub fn unmeasured(page: &str) -> String {
    let mut parts = page.split("<!-- measured -->");
    let mut out = parts.next().unwrap_or("").to_owned();
    for part in parts {
        out += part.split_once("<!-- /measured -->").map_or("<!-- measured -->", |(_, after)| after);
    }
    out
}
