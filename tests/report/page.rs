//! Whether a page is sound, and what its reader sees.

use std::collections::BTreeSet;

use quick_xml::events::Event as Xml;

use crate::text;

const SCRIPT: &str = include_str!("../../src/desk/report/page/replay.js");

/// The script's data.
pub fn data(page: &str) -> serde_json::Value {
    let (_, data) = page.split_once("id=\"replay-data\">").unwrap();
    serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap()
}

/// Well-formed XML without duplicate identifiers, scripts but the replay's, or anything to fetch; the text that a reader sees.
pub fn sound(page: &str) -> String {
    let mut reader = quick_xml::Reader::from_str(page);
    reader.config_mut().check_end_names = true;
    let mut ids = BTreeSet::new();
    let mut seen = String::new();
    let mut open = Vec::new();
    loop {
        match reader.read_event().unwrap() {
            Xml::Start(element) => {
                open.push(text(element.name().as_ref()));
                check(&element, &mut ids);
            }
            Xml::Empty(element) => check(&element, &mut ids),
            Xml::End(_) => {
                open.pop();
            }
            Xml::Text(run)
                if !open.iter().any(|name| ["style", "svg", "script"].contains(&name.as_str())) =>
            {
                seen.push_str(&run.decode().unwrap());
            }
            Xml::GeneralRef(reference) => {
                seen.push_str(match reference.decode().unwrap().as_ref() {
                    "amp" => "&",
                    "lt" => "<",
                    "gt" => ">",
                    "quot" => "\"",
                    other => panic!("&{other}; is no entity of XML"),
                });
            }
            Xml::Eof => break,
            _ => {}
        }
    }
    assert!(open.is_empty(), "{open:?} left open");
    // Its data and its code, or neither where there is nothing to replay.
    let replayed = page.contains("id=\"replay-data\"");
    assert_eq!(page.matches("<script").count(), if replayed { 2 } else { 0 });
    assert_eq!(page.contains(SCRIPT), replayed);
    for foreign in [
        "http:",
        "https:",
        "//www",
        "<link",
        "<img",
        "<iframe",
        "src=",
        "@import",
        "url(h",
        "fetch(",
        "XMLHttpRequest",
        "WebSocket",
        "import(",
        "eval(",
        "new Function",
        "innerHTML",
        "document.write",
    ] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    assert!(
        page.contains(
            "content=\"default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'\""
        )
    );
    seen
}

fn check(element: &quick_xml::events::BytesStart, ids: &mut BTreeSet<String>) {
    for attribute in element.attributes() {
        let attribute = attribute.unwrap();
        let value = text(&attribute.value);
        match attribute.key.as_ref() {
            b"id" => assert!(ids.insert(value.clone()), "two elements are called {value}"),
            b"points" | b"d" | b"x" | b"y" | b"width" | b"height" => {
                assert!(!value.contains("NaN") && !value.contains("inf"), "{value}");
            }
            _ => {}
        }
    }
}
