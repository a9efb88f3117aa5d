//! docs/json.md says what `--json` prints: every field that is printed stands there with its type, and every field that
//! stands there is printed by some case below, unless its type ends with `*` (it needs a rare input or a device).
//!
//! A new command: print it with `stdout::either(json, "NAME/1", ..)`, add a section to docs/json.md, and a case here.

use crate::support::{pslam, root, small_world, text, write_log, write_masks};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Forms that need a device, a feature, or minutes; their sections are written from the code.
const NOT_RUN: [&str; 6] = ["calibrate/1", "demo/1", "devices/1", "import-realsense/1", "import-sequence/1", "sync/1"];

/// Documented fields and their types, by schema.
fn documented() -> BTreeMap<String, BTreeMap<String, String>> {
    let text = fs::read_to_string(root().join("docs/json.md")).unwrap();
    let mut found: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
    let mut schema = None;
    for line in text.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            schema = heading.split('`').nth(1).filter(|name| name.contains('/')).map(str::to_owned);
            schema.iter().for_each(|name| drop(found.insert(name.clone(), BTreeMap::new())));
        } else if let (Some(name), Some(row)) = (&schema, line.strip_prefix("| `")) {
            let mut cells = row.split(" | ");
            let field = cells.next().unwrap().trim_end_matches('`').to_owned();
            found.get_mut(name).unwrap().insert(field, cells.next().unwrap().to_owned());
        }
    }
    found
}

/// Every field of a value with its type, `list[].name` for fields of elements.
fn flatten(path: &str, value: &Value, out: &mut BTreeSet<(String, &'static str)>) {
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(n) if n.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    if !path.is_empty() {
        out.insert((path.to_owned(), kind));
    }
    match value {
        Value::Array(values) => values.iter().for_each(|value| flatten(&format!("{path}[]"), value, out)),
        Value::Object(fields) => {
            let dot = if path.is_empty() { "" } else { "." };
            fields.iter().for_each(|(name, value)| flatten(&format!("{path}{dot}{name}"), value, out));
        }
        _ => {}
    }
}

/// Whether a documented path, whose `*` stand for any keys, names this field. Keys may hold dots and slashes.
fn names(documented: &str, field: &str) -> bool {
    let Some((before, after)) = documented.split_once('*') else { return documented == field };
    let Some(rest) = field.strip_prefix(before) else { return false };
    (1..=rest.len()).filter(|&end| rest.is_char_boundary(end)).any(|end| names(after, &rest[end..]))
}

/// Whether a documented type allows this one.
fn allows(documented: &str, kind: &str) -> bool {
    let kinds: Vec<&str> = documented.trim_end_matches('*').split(" or ").collect();
    // A number without a fraction is printed as one.
    kinds.contains(&kind) || kinds.contains(&"any") || kind == "integer" && kinds.contains(&"number")
}

/// Whether the field stands within one of type `any`, which is documented in words.
fn within_any(name: &str, kinds: &str, field: &str) -> bool {
    let inside = |(i, c): (usize, char)| "[.".contains(c) && names(name, &field[..i]);
    kinds.starts_with("any") && field.char_indices().any(inside)
}

/// Compares what was printed with the documentation; gives the schema and the documented fields that were seen.
fn compare(
    printed: &str,
    documented: &BTreeMap<String, BTreeMap<String, String>>,
    wrong: &mut BTreeSet<String>,
) -> (String, BTreeSet<String>) {
    let value: Value = serde_json::from_str(printed).unwrap_or_else(|e| panic!("{e}: {printed}"));
    let schema = value["schema"].as_str().unwrap_or_else(|| panic!("no schema in {printed}")).to_owned();
    let fields = documented.get(&schema).unwrap_or_else(|| panic!("docs/json.md has no section `{schema}`"));
    let mut found = BTreeSet::new();
    flatten("", &value, &mut found);
    let mut seen = BTreeSet::new();
    for (field, kind) in found.iter().filter(|(field, _)| field != "schema") {
        let is_row = |(name, kinds): &(&String, &String)| {
            names(name, field) && allows(kinds, kind) || within_any(name, kinds, field)
        };
        match fields.iter().find(is_row) {
            Some((name, _)) => drop(seen.insert(name.clone())),
            None => drop(wrong.insert(format!("{schema}: no row | `{field}` | {kind} | ... |"))),
        }
    }
    (schema, seen)
}

const SUITE: &str = "\
title = 'Test'
config = [{ name = 'full' }]
[[sequence]]
name = 'room'
log = 'a.mcap'
[[sequence]]
name = 'elsewhere'
log = 'elsewhere.mcap'
[[published]]
system = 'Other'
source = 'table 1'
ate_m = { room = 0.5 }
[[table]]
title = 'Errors'
value = 'ate_m'
published = ['Other']
";
const PERTURBED: &str = "\
title = 'Test'
perturbations = ['as-recorded']
config = [{ name = 'full' }]
sequence = [{ name = 'room', log = 'a.mcap' }]
";
const CAMERA: &str =
    r#"{"camera": "pinhole", "width": 16, "height": 12, "fx": 20, "fy": 20, "cx": 8, "cy": 6, "depth_scale": 5000}"#;
const RECORD: [&str; 9] =
    ["record", "--source", "synthetic", "--color", "160x120@30", "--depth", "160x120@30", "--duration", "2s"];
/// A black picture and a wall at one metre, 16 x 12 pixels.
const RGB_PNG: &str = "89504e470d0a1a0a0000000d49484452000000100000000c0802000000e485aad60000000f4944415478da63601805a3803a000\
    0024c0001ce8ca4630000000049454e44ae426082";
const DEPTH_PNG: &str = "89504e470d0a1a0a0000000d49484452000000100000000c10000000001e1cbe1e000000124944415478da6310eec00f194615\
    d04b0100c4637441fcb97d8c0000000049454e44ae426082";

/// The smallest data set: one frame with depth and truth, one picture alone.
fn write_tum(dir: &Path) {
    let bytes = |hex: &str| -> Vec<u8> {
        (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
    };
    for folder in ["rgb", "depth"] {
        fs::create_dir_all(dir.join(folder)).unwrap();
    }
    fs::write(dir.join("rgb/1.png"), bytes(RGB_PNG)).unwrap();
    fs::write(dir.join("depth/1.png"), bytes(DEPTH_PNG)).unwrap();
    fs::write(dir.join("camera.json"), CAMERA).unwrap();
    fs::write(dir.join("rgb.txt"), "1.0 rgb/1.png\n2.0 rgb/1.png\n").unwrap();
    fs::write(dir.join("depth.txt"), "1.001 depth/1.png\n").unwrap();
    fs::write(dir.join("groundtruth.txt"), "1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n").unwrap();
}

/// What commands print about a small world, one text a value.
fn cases(folder: &Path) -> Vec<String> {
    let path = |name: &str| text(&folder.join(name)).to_owned();
    let [log, run, none, cut, saved] = ["a.mcap", "run", "none", "cut.mcap", "saved.mcap"].map(path);
    write_log(&small_world(12), Path::new(&log), &mut |_| {});
    let bytes = fs::read(&log).unwrap();
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let [tum, page, imported, recorded] = ["tum", "page.html", "tum.mcap", "recorded.mcap"].map(path);
    let [piece, edited, redacted] = ["piece.mcap", "edited.mcap", "redacted.mcap"].map(path);
    let [exported, again, card] = ["exported", "again.mcap", "card"].map(path);
    let [suite, suite_out] = ["suite.toml", "suite"].map(path);
    let [perturbed, perturbed_out] = ["perturbed.toml", "perturbed"].map(path);
    let [masks, small_masks, labelled] = ["masks", "small_masks", "labelled.mcap"].map(path);
    write_masks(Path::new(&masks), (320, 240), 12);
    write_masks(Path::new(&small_masks), (160, 120), 90);
    write_tum(Path::new(&tum));
    fs::write(&suite, SUITE).unwrap();
    fs::write(&perturbed, PERTURBED).unwrap();
    let commands: Vec<Vec<&str>> = vec![
        vec!["info", &log],
        vec!["check", &log],
        vec!["check", &cut],
        vec!["recover", &cut, "-o", &saved],
        vec!["config"],
        vec!["replay", &log, "-o", &run],
        vec!["replay", &log, "-o", &none, "--preset", "none", "--frames", "0..99"],
        vec!["verify", &run],
        vec!["diff", &run, &none],
        vec!["eval", &run],
        vec!["report", &run, "-o", &page],
        vec!["bench", &log],
        vec!["suite", &suite, "-o", &suite_out],
        vec!["suite", &perturbed, "-o", &perturbed_out],
        vec!["import", "tum", &tum, "-o", &imported],
        vec!["export", "png", &log, "-o", &exported],
        vec!["import", "png", &exported, "-o", &again],
        vec!["card", &log, "-o", &card],
        vec!["slice", &log, "--frames", "2..7", "-o", &piece],
        vec!["merge", &piece, &log, "-o", &edited, "--dry-run"],
        vec!["filter", &log, "-n", "/camera/.*", "-o", &edited],
        vec!["compress", &log, "--level", "3", "-o", &edited, "--dry-run"],
        vec!["redact", &log, "-o", &redacted],
        vec!["eval-masks", &log, "--layer", "panoptic", "--truth", "panoptic"],
        vec!["annotate", &log, "--masks", &masks, "-o", &labelled],
        [&RECORD[..], &["--segment", "--masks", &small_masks, "-o", &recorded]].concat(),
    ];
    let run = |arguments: &Vec<&str>| {
        let output = pslam(&[arguments.as_slice(), &["--json"]].concat());
        let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(!out.is_empty(), "pslam {}: {err}", arguments.join(" "));
        // A stream of lines, or one value over many.
        if out.starts_with("{\n") { vec![out.into_owned()] } else { out.lines().map(str::to_owned).collect() }
    };
    commands.iter().flat_map(run).collect()
}

#[test]
fn the_documentation_is_what_is_printed() {
    let folder = tempfile::tempdir().unwrap();
    let documented = documented();
    let mut seen: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut wrong: BTreeSet<String> = BTreeSet::new();
    for printed in cases(folder.path()) {
        let (schema, fields) = compare(&printed, &documented, &mut wrong);
        seen.entry(schema).or_default().extend(fields);
    }
    for (schema, fields) in documented.iter().filter(|(schema, _)| !NOT_RUN.contains(&schema.as_str())) {
        let seen = seen.get(schema).unwrap_or_else(|| panic!("no case in tests/it/json.rs prints `{schema}`"));
        let never = fields.iter().filter(|(field, kind)| !kind.ends_with('*') && !seen.contains(*field));
        wrong.extend(never.map(|(field, kind)| format!("{schema}: never printed | `{field}` | {kind} |")));
    }
    let wrong: Vec<String> = wrong.into_iter().collect();
    assert!(wrong.is_empty(), "docs/json.md:\n{}", wrong.join("\n"));
}

/// Commands with `--json`, with the commands above them.
fn with_json(command: &clap::Command, path: &str, found: &mut Vec<String>) {
    for below in command.get_subcommands() {
        let path = format!("{path} {}", below.get_name());
        if below.get_arguments().any(|argument| argument.get_id() == "json") {
            found.push(path.clone());
        }
        with_json(below, &path, found);
    }
}

#[test]
fn every_command_with_json_is_documented() {
    let docs = fs::read_to_string(root().join("docs/json.md")).unwrap();
    let headings: Vec<&str> = docs.lines().filter(|line| line.starts_with("## ")).collect();
    let mut commands = Vec::new();
    with_json(&panoptic_slam::help::command(), "pslam", &mut commands);
    assert!(commands.len() > 15, "{commands:?}");
    for command in commands {
        let there = headings.iter().any(|heading| heading.contains(&format!("`{command}`")));
        assert!(there, "docs/json.md: no heading names `{command}`");
    }
}

#[test]
fn the_comparison_can_fail() {
    let table = |rows: &[(&str, &str)]| {
        let rows = rows.iter().map(|(field, kind)| ((*field).to_owned(), (*kind).to_owned())).collect();
        BTreeMap::from([("x/1".to_owned(), rows)])
    };
    let printed = r#"{"schema":"x/1","a":[{"b":null}],"m":{"/any.key":1}}"#;
    let rows = [("a", "array"), ("a[]", "object"), ("a[].b", "string or null"), ("m", "object"), ("m.*", "integer")];
    let wrong = |rows: &[(&str, &str)]| {
        let mut wrong = BTreeSet::new();
        compare(printed, &table(rows), &mut wrong);
        wrong.len()
    };
    assert_eq!(wrong(&rows), 0);
    for without in 0..rows.len() {
        let fewer: Vec<_> = rows.iter().enumerate().filter(|(i, _)| *i != without).map(|(_, row)| *row).collect();
        assert_eq!(wrong(&fewer), 1, "{:?}", rows[without]);
    }
}
