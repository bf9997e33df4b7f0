//! Edits of a JSON text that leave every byte they do not touch as it was.
//!
//! In: the source text. Out: the text with values replaced, items appended to arrays and members put into objects.
//! Key order, spelling of numbers (`1.50`, `1e5`), escapes and white space elsewhere stay. No re-serialisation keeps
//! them: parsers drop the spelling. So `serde_json` only finds the spans ([`Element`]), and [`Splice`] works on text.
//!
//! What is added takes over the white space before its predecessor in the array or object, so an indented file stays
//! readable. Of a key that occurs twice the last counts, as for most parsers.

use serde::de::IgnoredAny;
use serde::de::MapAccess;
use serde::de::SeqAccess;
use serde::de::Visitor;
use serde_json::value::RawValue;
use std::collections::BTreeMap;
use std::collections::BTreeSet;

/// Why an edit is impossible: the text is no JSON, or an array or object was expected and something else is there.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Fault(String);

fn fault<T>(message: impl Into<String>) -> Result<T, Fault> {
    Err(Fault(message.into()))
}

/// Largest integer that a double holds exactly.
const MAX_INDEX: f64 = 9_007_199_254_740_991.0;

/// One value in a JSON text.
#[derive(Debug, Clone, Copy)]
pub struct Element<'a> {
    text: &'a str,
    start: usize,
}

impl<'a> Element<'a> {
    /// The value that a whole text holds.
    ///
    /// # Errors
    /// If it is no JSON.
    pub fn root(source: &'a str) -> Result<Self, Fault> {
        let raw: &RawValue = serde_json::from_str(source).map_err(|e| Fault(format!("not JSON: {e}")))?;
        Ok(Self::within(source, 0, raw))
    }

    /// `raw` borrows from `outer`, which starts at `start`.
    fn within(outer: &'a str, start: usize, raw: &'a RawValue) -> Self {
        let text = raw.get();
        Self { text, start: start + (text.as_ptr() as usize - outer.as_ptr() as usize) }
    }

    /// Its source text.
    #[must_use]
    pub fn text(&self) -> &'a str {
        self.text
    }

    fn end(&self) -> usize {
        self.start + self.text.len()
    }

    /// It is an object.
    #[must_use]
    pub fn is_object(&self) -> bool {
        self.text.starts_with('{')
    }

    /// Members of an object in order; empty for anything else.
    #[must_use]
    pub fn members(&self) -> Vec<(String, Self)> {
        let parsed: Result<Members<'a>, _> = serde_json::from_str(self.text);
        let place = |(key, raw)| (key, Self::within(self.text, self.start, raw));
        parsed.map(|m| m.0.into_iter().map(place).collect()).unwrap_or_default()
    }

    /// Items of an array in order; empty for anything else.
    #[must_use]
    pub fn items(&self) -> Vec<Self> {
        let parsed: Result<Items<'a>, _> = serde_json::from_str(self.text);
        parsed
            .map(|i| i.0.into_iter().map(|raw| Self::within(self.text, self.start, raw)).collect())
            .unwrap_or_default()
    }

    /// The member `key` of an object.
    #[must_use]
    pub fn get(&self, key: &str) -> Option<Self> {
        self.members().into_iter().rev().find(|(k, _)| k == key).map(|(_, e)| e)
    }

    /// The value at a path of keys.
    #[must_use]
    pub fn find(&self, path: &[&str]) -> Option<Self> {
        path.iter().try_fold(*self, |e, key| e.get(key))
    }

    /// Items of the array at `key`; empty if there is none.
    #[must_use]
    pub fn array(&self, key: &str) -> Vec<Self> {
        self.get(key).map(|e| e.items()).unwrap_or_default()
    }

    /// A number that is an index or a count; it may be spelled with a zero fraction (glTF 2.0, section 2.7).
    #[must_use]
    pub fn index(&self) -> Option<usize> {
        let number: f64 = serde_json::from_str(self.text).ok()?;
        ((0.0..=MAX_INDEX).contains(&number) && number.fract() == 0.0).then_some(number as usize)
    }

    /// The index at `key`.
    #[must_use]
    pub fn index_at(&self, key: &str) -> Option<usize> {
        self.get(key)?.index()
    }

    /// A string, with its escapes resolved.
    #[must_use]
    pub fn string(&self) -> Option<String> {
        serde_json::from_str(self.text).ok()
    }
}

struct Members<'a>(Vec<(String, &'a RawValue)>);

impl<'a> serde::Deserialize<'a> for Members<'a> {
    fn deserialize<D: serde::Deserializer<'a>>(deserializer: D) -> Result<Self, D::Error> {
        struct V;
        impl<'a> Visitor<'a> for V {
            type Value = Members<'a>;

            fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'a>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut all = Vec::new();
                while let Some(member) = map.next_entry::<String, &'a RawValue>()? {
                    all.push(member);
                }
                Ok(Members(all))
            }
        }
        deserializer.deserialize_map(V)
    }
}

struct Items<'a>(Vec<&'a RawValue>);

impl<'a> serde::Deserialize<'a> for Items<'a> {
    fn deserialize<D: serde::Deserializer<'a>>(deserializer: D) -> Result<Self, D::Error> {
        struct V;
        impl<'a> Visitor<'a> for V {
            type Value = Items<'a>;

            fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str("an array")
            }

            fn visit_seq<A: SeqAccess<'a>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
                let mut all = Vec::new();
                while let Some(item) = seq.next_element::<&'a RawValue>()? {
                    all.push(item);
                }
                Ok(Items(all))
            }
        }
        deserializer.deserialize_seq(V)
    }
}

/// Edits of one text, collected and then applied together.
pub struct Splice<'a> {
    source: &'a str,
    /// Start → (end, new text).
    replaced: BTreeMap<usize, (usize, String)>,
    /// Position after the last child → what goes there.
    added: BTreeMap<usize, Addition>,
    /// Positions after the last child of arrays of which nothing stays.
    emptied: BTreeSet<usize>,
}

struct Addition {
    /// White space before each added child.
    space: String,
    /// There is a child already.
    comma: bool,
    texts: Vec<String>,
}

impl<'a> Splice<'a> {
    /// No edits yet.
    #[must_use]
    pub fn new(source: &'a str) -> Self {
        Self { source, replaced: BTreeMap::new(), added: BTreeMap::new(), emptied: BTreeSet::new() }
    }

    /// Puts `text` in the place of `element`. A second replacement of the same element wins.
    pub fn replace(&mut self, element: &Element<'_>, text: impl Into<String>) {
        self.replaced.insert(element.start, (element.end(), text.into()));
    }

    /// Appends values to an array.
    ///
    /// # Errors
    /// If `array` is not one.
    pub fn append(&mut self, array: &Element<'_>, texts: impl IntoIterator<Item = String>) -> Result<(), Fault> {
        if !array.text.starts_with('[') {
            return fault(format!("expected an array in place of `{}`", shortened(array.text)));
        }
        self.add(array, array.items().last(), texts.into_iter().collect());
        Ok(())
    }

    /// Replaces the value of `key`, or adds the member.
    ///
    /// # Errors
    /// If `object` is not one.
    pub fn set(&mut self, object: &Element<'_>, key: &str, text: impl AsRef<str>) -> Result<(), Fault> {
        self.set_path(object, &[key], text)
    }

    /// Replaces the value at a path of keys; objects that are missing on the way are made. Two paths must not share a
    /// missing object.
    ///
    /// # Errors
    /// If something on the way is not an object.
    pub fn set_path(&mut self, object: &Element<'_>, path: &[&str], text: impl AsRef<str>) -> Result<(), Fault> {
        let Some((key, rest)) = path.split_first() else {
            self.replace(object, text.as_ref());
            return Ok(());
        };
        if !object.is_object() {
            return fault(format!("expected an object in place of `{}`", shortened(object.text)));
        }
        let members = object.members();
        if let Some((_, value)) = members.iter().rev().find(|(k, _)| k == key) {
            return self.set_path(value, rest, text);
        }
        let mut value = text.as_ref().to_owned();
        for key in rest.iter().rev() {
            value = format!("{{{}: {value}}}", quoted(key));
        }
        self.add(object, members.last().map(|(_, e)| e), vec![format!("{}: {value}", quoted(key))]);
        Ok(())
    }

    /// Takes a member out of an object, with the comma and the white space that belong to it. Nothing happens if there is
    /// none. The first two members of an object cannot both go in one splice.
    ///
    /// # Errors
    /// If `object` is not one.
    pub fn remove(&mut self, object: &Element<'_>, key: &str) -> Result<(), Fault> {
        if !object.is_object() {
            return fault(format!("expected an object in place of `{}`", shortened(object.text)));
        }
        let members = object.members();
        for (i, (_, value)) in members.iter().enumerate().filter(|(_, (k, _))| k == key) {
            let (mut start, mut end) = (object.start + 1, value.end());
            if i > 0 {
                start = members[i - 1].1.end();
            } else if members.len() > 1 {
                let rest = &object.text[end - object.start..];
                end += rest.find(',').map_or(0, |comma| comma + 1);
            }
            self.replaced.insert(start, (end, String::new()));
        }
        Ok(())
    }

    /// Takes all items but the first `kept` out of an array. To be called before something is appended, which then follows
    /// those.
    ///
    /// # Errors
    /// If `array` is not one.
    pub fn truncate(&mut self, array: &Element<'_>, kept: usize) -> Result<(), Fault> {
        if !array.text.starts_with('[') {
            return fault(format!("expected an array in place of `{}`", shortened(array.text)));
        }
        let items = array.items();
        if let Some(last) = items.last().filter(|_| kept < items.len()) {
            let start = kept.checked_sub(1).map_or(array.start + 1, |k| items[k].end());
            self.replaced.insert(start, (last.end(), String::new()));
            self.emptied.extend((kept == 0).then_some(last.end()));
        }
        Ok(())
    }

    /// Appends values to the array at `key` of an object, which is made if it is missing.
    ///
    /// # Errors
    /// If there is something else.
    pub fn append_at(&mut self, object: &Element<'_>, key: &str, texts: Vec<String>) -> Result<(), Fault> {
        if texts.is_empty() {
            return Ok(());
        }
        match object.get(key) {
            Some(array) => self.append(&array, texts),
            None => self.set(object, key, format!("[{}]", texts.join(", "))),
        }
    }

    fn add(&mut self, container: &Element<'_>, last: Option<&Element<'_>>, texts: Vec<String>) {
        let at = last.map_or(container.start + 1, Element::end);
        let space = || space_before_last(container, last);
        let comma = last.is_some() && !self.emptied.contains(&at);
        let entry = self.added.entry(at);
        entry.or_insert_with(|| Addition { space: space(), comma, texts: Vec::new() }).texts.extend(texts);
    }

    /// The text with all edits.
    ///
    /// # Errors
    /// If edits overlap.
    pub fn apply(self) -> Result<String, Fault> {
        let mut edits: Vec<(usize, usize, String)> = Vec::new();
        edits.extend(self.replaced.into_iter().map(|(start, (end, text))| (start, end, text)));
        for (at, addition) in self.added {
            let mut text = String::new();
            for item in &addition.texts {
                if addition.comma || !text.is_empty() {
                    text.push(',');
                }
                text += &addition.space;
                text += item;
            }
            edits.push((at, at, text));
        }
        // At one position a replacement that ends there comes before what is added behind it.
        edits.sort_by_key(|&(start, end, _)| (start, end));
        let mut out = String::with_capacity(self.source.len() + edits.iter().map(|e| e.2.len()).sum::<usize>());
        let mut done = 0;
        for (start, end, text) in edits {
            match self.source.get(done..start) {
                Some(kept) => out += kept,
                None => return fault("two edits overlap"),
            }
            out += &text;
            done = end;
        }
        out += self.source.get(done..).unwrap_or_default();
        Ok(out)
    }
}

/// White space between the delimiter before the last child and that child; nothing if there is none.
fn space_before_last(container: &Element<'_>, last: Option<&Element<'_>>) -> String {
    let Some(last) = last else { return String::new() };
    let mut before = &container.text[..last.start - container.start];
    if container.is_object() {
        // Step back over the colon and the key; the key's own quote is the first one that no backslash escapes.
        before = before.trim_end().trim_end_matches(':').trim_end();
        let mut key_start = before.len() - 1;
        while let Some(quote) = before[..key_start].rfind('"') {
            key_start = quote;
            let backslashes = before[..quote].bytes().rev().take_while(|&b| b == b'\\').count();
            if backslashes % 2 == 0 {
                break;
            }
        }
        before = &before[..key_start];
    }
    before[before.trim_end().len()..].to_owned()
}

/// A string as JSON.
#[must_use]
pub fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

/// Whether a text is JSON.
#[must_use]
pub fn is_json(text: &str) -> bool {
    serde_json::from_str::<IgnoredAny>(text).is_ok()
}

fn shortened(text: &str) -> String {
    text.chars().take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const NASTY: &str = "\u{20}{ \"a\" : 1.50,\n\t\"b\\u0022\\\\\":1e5 , \"deep\":{\"x\":[[],[ ],{ }],\"e\":{},\"s\":\"\\ud83d\\ude00 ü \\/ ]}\"},\
        \"n\":12345678901234567890123,\"list\":[1E+2,\n  -0.0 ,\n  2.00],\"none\":null, \"a2\": true }\n";

    fn at<'a>(root: &Element<'a>, path: &[&str]) -> Element<'a> {
        root.find(path).unwrap()
    }

    #[test]
    fn no_edit_no_change() {
        assert_eq!(Splice::new(NASTY).apply().unwrap(), NASTY);
    }

    #[test]
    fn elements_are_found_with_their_spelling() {
        let root = Element::root(NASTY).unwrap();
        assert_eq!(root.get("a").unwrap().text(), "1.50");
        assert_eq!(root.get("b\"\\").unwrap().text(), "1e5");
        assert_eq!(at(&root, &["deep", "x"]).items()[2].text(), "{ }");
        assert_eq!(at(&root, &["deep", "s"]).string().unwrap(), "😀 ü / ]}");
        let numbers = ["3", "3.0", "3e0", "3.5", "-1", "\"3\"", "1e300"].map(|t| Element::root(t).unwrap().index());
        assert_eq!(numbers, [Some(3), Some(3), Some(3), None, None, None, None]);
        assert!(root.get("missing").is_none() && root.get("none").unwrap().items().is_empty());
        for (_, e) in root.members() {
            assert_eq!(&NASTY[e.start..e.end()], e.text());
        }
        assert!(Element::root("{\"a\":}").is_err() && Element::root("").is_err() && Element::root("1 2").is_err());
    }

    #[test]
    fn edits_touch_only_their_place() {
        let root = Element::root(NASTY).unwrap();
        let mut splice = Splice::new(NASTY);
        splice.append_at(&root, "list", vec!["7".into(), "8".into()]).unwrap();
        splice.append(&at(&root, &["deep", "x"]).items()[1], ["9".to_owned()]).unwrap();
        splice.set(&root, "a", "[2]").unwrap();
        splice.set_path(&root, &["deep", "e", "new", "er"], "\"v\"").unwrap();
        splice.append_at(&root, "made", vec!["1".into()]).unwrap();
        splice.set(&root, "last", "0").unwrap();
        let expected = NASTY
            .replace("1.50", "[2]")
            .replace("2.00]", "2.00,\n  7,\n  8]")
            .replace("[ ]", "[9 ]")
            .replace("\"e\":{}", "\"e\":{\"new\": {\"er\": \"v\"}}")
            .replace("true", "true, \"made\": [1], \"last\": 0");
        let text = splice.apply().unwrap();
        assert_eq!(text, expected);
        assert!(is_json(&text));
    }

    #[test]
    fn adding_after_an_edited_last_child_keeps_both() {
        let source = "{\"a\":[1,{\"k\":2}]}";
        let root = Element::root(source).unwrap();
        let array = root.get("a").unwrap();
        let mut splice = Splice::new(source);
        splice.append(&array, ["3".to_owned()]).unwrap();
        splice.set(&array.items()[1], "k", "4").unwrap();
        splice.set(&array.items()[1], "l", "5").unwrap();
        assert_eq!(splice.apply().unwrap(), "{\"a\":[1,{\"k\":4,\"l\": 5},3]}");
        let mut splice = Splice::new(source);
        splice.append(&array, ["3".to_owned()]).unwrap();
        splice.replace(&array.items()[1], "9");
        assert_eq!(splice.apply().unwrap(), "{\"a\":[1,9,3]}");
    }

    #[test]
    fn members_go_with_their_commas() {
        let without = |source: &str, key: &str| {
            let mut splice = Splice::new(source);
            splice.remove(&Element::root(source).unwrap(), key).unwrap();
            splice.apply().unwrap()
        };
        let source = "{ \"a\": {\"b\": 2},\n  \"b\" : [1, 2] ,\n  \"c\": 3 }";
        assert_eq!(without(source, "a"), "{\n  \"b\" : [1, 2] ,\n  \"c\": 3 }");
        assert_eq!(without(source, "b"), "{ \"a\": {\"b\": 2} ,\n  \"c\": 3 }");
        assert_eq!(without(source, "c"), "{ \"a\": {\"b\": 2},\n  \"b\" : [1, 2] }");
        assert_eq!((without(source, "d"), without("{ \"a\": 1 }", "a")), (source.to_owned(), "{ }".to_owned()));
    }

    #[test]
    fn impossible_edits_are_faults() {
        let root = Element::root(NASTY).unwrap();
        let mut splice = Splice::new(NASTY);
        assert!(splice.append_at(&root, "deep", vec!["1".into()]).is_err());
        assert!(splice.set_path(&root, &["list", "x"], "1").is_err());
        splice.replace(&root.get("deep").unwrap(), "0");
        splice.set_path(&root, &["deep", "e", "x"], "1").unwrap();
        assert!(splice.apply().is_err());
    }

    #[test]
    fn the_last_of_two_equal_keys_counts() {
        let source = "{\"a\":1,\"a\":2}";
        let root = Element::root(source).unwrap();
        let mut splice = Splice::new(source);
        splice.set(&root, "a", "3").unwrap();
        assert_eq!(splice.apply().unwrap(), "{\"a\":1,\"a\":3}");
    }

    #[test]
    fn escaped_quotes_in_the_last_key_do_not_confuse_the_indent() {
        let source = "{\n  \"x\": 1,\n  \"q\\\"\\\\\" : 2\n}";
        let root = Element::root(source).unwrap();
        let mut splice = Splice::new(source);
        splice.set(&root, "y", "3").unwrap();
        assert_eq!(splice.apply().unwrap(), "{\n  \"x\": 1,\n  \"q\\\"\\\\\" : 2,\n  \"y\": 3\n}");
    }
}
