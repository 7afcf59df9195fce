//! The pair protocol's document against the dialect: every message, field, unit and enum value is told as the XML has
//! it, and nothing else is.

// Helpers of tests may fail the test.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

const XML: &str = include_str!("../message_definitions/veilwing.xml");
const DOC: &str = include_str!("../docs/pair-protocol.md");

fn attribute(element: &BytesStart<'_>, name: &str) -> Option<String> {
    let found = element.attributes().flatten().find(|a| a.key.as_ref() == name.as_bytes())?;
    Some(String::from_utf8(found.value.into_owned()).unwrap())
}

/// The wire format's chapter as the XML has it: headings with their description, then the tables' rows.
fn expected() -> Vec<(String, Vec<String>)> {
    let mut reader = Reader::from_str(XML);
    let (mut messages, mut enums) = (Vec::new(), Vec::new());
    let (mut path, mut text): (Vec<String>, String) = (Vec::new(), String::new());
    let (mut row, mut section): (String, (String, Vec<String>)) = Default::default();
    loop {
        match reader.read_event().unwrap() {
            Event::Eof => break,
            Event::Start(start) => {
                let name = String::from_utf8(start.name().as_ref().to_vec()).unwrap();
                let of = |what: &str| attribute(&start, what).unwrap_or_default();
                match name.as_str() {
                    "message" => section = (format!("### {} ({})", of("name"), of("id")), Vec::new()),
                    "enum" => section = (format!("### {}", of("name")), Vec::new()),
                    "field" => {
                        let unit = attribute(&start, "units").or_else(|| attribute(&start, "enum"));
                        let unit = unit.unwrap_or_default();
                        row = format!("| `{}` | `{}` | {unit} | ", of("name"), of("type"));
                    }
                    "entry" => {
                        let enumeration = section.0.trim_start_matches("### ").to_owned() + "_";
                        let short = of("name").replacen(&enumeration, "", 1);
                        row = format!("| {} | `{short}` | ", of("value"));
                    }
                    _ => {}
                }
                path.push(name);
                text.clear();
            }
            Event::Text(part) => text += &part.decode().unwrap(),
            // An apostrophe or the like.
            Event::GeneralRef(entity) => panic!("write &{entity:?}; as it is"),
            Event::End(_) => {
                let name = path.pop().unwrap();
                match (name.as_str(), path.last().map(String::as_str)) {
                    ("field", _) => section.1.push(format!("{row}{} |", text.trim())),
                    ("description", Some("entry")) => section.1.push(format!("{row}{} |", text.trim())),
                    ("description", Some("message" | "enum")) => section.1.push(text.trim().to_owned()),
                    ("message", _) => messages.push(std::mem::take(&mut section)),
                    ("enum", _) => enums.push(std::mem::take(&mut section)),
                    _ => {}
                }
                text.clear();
            }
            _ => {}
        }
    }
    messages.extend(enums);
    messages
}

#[test]
fn val_the_document_tells_the_wire_format_as_the_xml_has_it() {
    let chapter = DOC.split_once("## Wire format").unwrap().1;
    let sections = expected();
    assert!(sections.len() >= 16, "{} messages and enums", sections.len());
    for (heading, lines) in &sections {
        let (_, section) = chapter
            .split_once(&format!("\n{heading}\n"))
            .unwrap_or_else(|| panic!("{heading} is not in the document"));
        let section = section.split("\n### ").next().unwrap();
        for line in lines {
            assert!(
                section.lines().any(|told| told == line),
                "{heading}: not told as\n{line}\nbut\n{section}"
            );
        }
        let rows =
            |text: &str| text.lines().filter(|line| line.starts_with("| ") && line.contains('`')).count();
        let expected = lines.iter().filter(|line| line.starts_with("| ")).count();
        assert_eq!(rows(section), expected, "{heading}: rows that the XML does not have");
    }
    let told = chapter.lines().filter(|line| line.starts_with("### VEILWING_")).count();
    assert_eq!(told, sections.len(), "headings that the XML does not have");
}

#[test]
fn val_every_message_is_in_a_diagram_or_a_rule_and_every_diagram_is_closed() {
    let before = DOC.split_once("## Wire format").unwrap().0;
    for (heading, _) in expected() {
        let name = heading.trim_start_matches("### VEILWING_");
        let name = name.split(' ').next().unwrap();
        let told = before.contains(name) || ["CLOCK", "ROLE", "FLAGS", "SILENCE"].contains(&name);
        assert!(told, "{name} is in no diagram");
    }
    let (mut open, mut depth, mut diagrams) = (false, 0_i32, 0);
    for line in before.lines() {
        let word = line.split_whitespace().next().unwrap_or_default();
        match word {
            "```mermaid" => (open, depth, diagrams) = (true, 0, diagrams + 1),
            "```" if open => {
                assert!(depth == 0, "a loop or a choice without its end before {line}");
                open = false;
            }
            "loop" | "alt" if open => depth += 1,
            "end" if open => depth -= 1,
            _ => {}
        }
    }
    assert!(diagrams >= 14 && !open, "{diagrams} diagrams");
}
