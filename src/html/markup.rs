//! Text, numbers and pictures as HTML.

use super::Image;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;

/// Text that means itself, between tags and in quoted attributes. Control characters, which HTML forbids, become U+FFFD.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            '\n' | '\t' => out.push(' '),
            c if c.is_control() => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// An `img` element; `alt` is text.
pub(super) fn picture(image: &Image, class: &str, alt: &str) -> String {
    let Image { mime, bytes, size: [width, height] } = image;
    let data = STANDARD.encode(bytes);
    let alt = escaped(alt);
    format!(
        "<img class=\"{class}\" width=\"{width}\" height=\"{height}\" alt=\"{alt}\" src=\"data:{mime};base64,{data}\">"
    )
}

/// What depends on the machine.
pub(super) fn measured(html: &str) -> String {
    format!("<!-- measured -->{html}<!-- /measured -->")
}

/// With commas between thousands.
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Rounded to so many digits, without zeros behind the point; powers of ten where there would be many zeros.
pub(super) fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".to_owned() } else { value.to_string() };
    }
    let exponent = libm::floor(libm::log10(value.abs())) as i32;
    if !(-4..7).contains(&exponent) {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let places = (digits as i32 - 1 - exponent).max(0) as usize;
    let text = format!("{value:.places$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// A part of one, as a percentage.
pub(super) fn percent(part: f64) -> String {
    format!("{} %", significant(part * 100.0, 3))
}

/// A size in bytes, in the largest unit that fits.
pub(super) fn size(bytes: u64) -> String {
    let units = [(1u64 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")];
    match units.iter().find(|(unit, _)| bytes >= *unit) {
        Some((unit, name)) => format!("{:.1} {name}", bytes as f64 / *unit as f64),
        None => format!("{bytes} B"),
    }
}

/// A time for people.
pub(super) fn seconds(seconds: f64) -> String {
    if seconds < 99.5 { format!("{seconds:.2} s") } else { format!("{:.1} min", seconds / 60.0) }
}

/// Fills `{{name}}` in a template. What is filled in is not looked at again. Names that are not given stay, so that a
/// test can find them.
pub(super) fn filled(template: &str, values: &[(&str, &str)]) -> String {
    let mut out = String::with_capacity(template.len() + values.iter().map(|(_, v)| v.len()).sum::<usize>());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        out += before;
        let named = after.split_once("}}");
        let found = named.and_then(|(name, tail)| Some((values.iter().find(|(n, _)| *n == name)?.1, tail)));
        let (text, tail) = found.unwrap_or(("{{", after));
        out += text;
        rest = tail;
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        assert_eq!(escaped("<script>a&\"b\"'\0\n"), "&lt;script&gt;a&amp;&quot;b&quot;&#39;\u{fffd} ");
    }

    #[test]
    fn numbers_for_people() {
        assert_eq!([0, 999, 1000, 639_079].map(count), ["0", "999", "1,000", "639,079"]);
        let shown = [0.0, 0.020_04, 16.0, 1234.5, 0.5, 1e-7, 99.96].map(|v| significant(v, 3));
        assert_eq!(shown, ["0", "0.02", "16", "1234", "0.5", "1.00e-7", "100"]);
        assert_eq!(percent(0.0234), "2.34 %");
        assert_eq!([512, 2048, 3 << 20].map(size), ["512 B", "2.0 KiB", "3.0 MiB"]);
        assert_eq!([1.234, 99.6].map(seconds), ["1.23 s", "1.7 min"]);
    }

    #[test]
    fn what_is_filled_in_is_not_filled_again() {
        assert_eq!(filled("a{{x}}b{{y}}c", &[("x", "{{y}}"), ("y", "<")]), "a{{y}}b<c");
        assert_eq!(filled("{{z}} {{x", &[("x", "1")]), "{{z}} {{x");
    }
}
