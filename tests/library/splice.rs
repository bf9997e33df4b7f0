//! Splicing of JSON text against random documents: what is edited changes, every other byte stays.

use proptest::prelude::*;
use serde_json::Value;
use texelwalk::output::splice::Element;
use texelwalk::output::splice::Splice;

const SCALARS: [&str; 13] = [
    "1.50",
    "1e5",
    "-0.0",
    "1E+2",
    "12345678901234567890123",
    "0.1",
    "true",
    "null",
    "\"\"",
    "\"a\\\"]}\\\\\"",
    "\"\\u00e9\\ud83d\\ude00\"",
    "\"ü{[,:\"",
    "\"\\/\"",
];
const KEYS: [&str; 5] = ["\"a\"", "\"b b\"", "\"\\u0063\"", "\"d\\\"\\\\\"", "\"ü\""];

/// JSON text with odd white space and spelling.
fn json() -> impl Strategy<Value = String> {
    let space = || prop::sample::select(vec!["", " ", "\n\t", "\r\n  "]);
    let scalar = prop::sample::select(SCALARS.to_vec()).prop_map(str::to_owned);
    scalar.prop_recursive(5, 60, 5, move |inner| {
        let array =
            (prop::collection::vec((space(), inner.clone(), space()), 0..5), space()).prop_map(|(items, end)| {
                let items: Vec<String> = items.iter().map(|(a, v, b)| format!("{a}{v}{b}")).collect();
                format!("[{}{end}]", items.join(","))
            });
        let member = (space(), prop::sample::select(KEYS.to_vec()), space(), space(), inner, space());
        let object = (prop::collection::vec(member, 0..5), space()).prop_map(|(members, end)| {
            let (mut seen, mut out) = (Vec::new(), Vec::new());
            for (a, k, b, c, v, d) in &members {
                if !seen.contains(k) {
                    seen.push(*k);
                    out.push(format!("{a}{k}{b}:{c}{v}{d}"));
                }
            }
            format!("{{{}{end}}}", out.join(","))
        });
        prop_oneof![array, object]
    })
}

/// All elements below one, itself included, with their JSON pointers.
fn all<'a>(element: Element<'a>, pointer: &str, out: &mut Vec<(String, Element<'a>)>) {
    for (key, value) in element.members() {
        all(value, &format!("{pointer}/{}", key.replace('~', "~0").replace('/', "~1")), out);
    }
    for (i, item) in element.items().into_iter().enumerate() {
        all(item, &format!("{pointer}/{i}"), out);
    }
    out.push((pointer.to_owned(), element));
}

fn parse(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 500,
        rng_seed: proptest::test_runner::RngSeed::Fixed(7),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn an_edit_changes_one_value_and_no_other_byte(
        source in json(),
        pick in any::<prop::sample::Index>(),
        edit in 0..3u8,
    ) {
        let mut elements = Vec::new();
        all(Element::root(&source).unwrap(), "", &mut elements);
        let (pointer, element) = pick.get(&elements);
        let mut expected = parse(&source);
        let target = expected.pointer_mut(pointer).unwrap();
        prop_assert_eq!(&*target, &parse(element.text()));
        let mut splice = Splice::new(&source);
        match (edit, &mut *target) {
            (0, Value::Array(items)) => {
                items.extend([Value::from(7), Value::from("x")]);
                splice.append(element, ["7".to_owned(), "\"x\"".to_owned()]).unwrap();
            }
            (1, Value::Object(map)) => {
                map.insert("new".to_owned(), serde_json::json!({"er": [1]}));
                splice.set_path(element, &["new", "er"], "[1]").unwrap();
            }
            (_, target) => {
                *target = Value::from("replaced");
                splice.replace(element, "\"replaced\"");
            }
        }
        let adds = edit < 2 && (element.is_object() && edit == 1 || element.text().starts_with('[') && edit == 0);
        let text = splice.apply().unwrap();
        prop_assert_eq!(parse(&text), expected);
        let before = source.bytes().zip(text.bytes()).take_while(|(a, b)| a == b).count();
        let behind = source.bytes().rev().zip(text.bytes().rev()).take_while(|(a, b)| a == b).count();
        let touched = source.len().saturating_sub(before + behind);
        let allowed = if adds { 0 } else { element.text().len() };
        prop_assert!(touched <= allowed, "{} bytes changed for {:?}", touched, element.text());
    }

    #[test]
    fn no_edit_gives_the_same_bytes(source in json()) {
        prop_assert_eq!(Splice::new(&source).apply().unwrap(), source);
    }
}
