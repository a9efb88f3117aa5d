//! Rules of STYLE.md that no other tool checks.

use crate::layers::rust_files;
use crate::support::root;
use std::fs;
use std::path::PathBuf;

const MAX_FILE_LINES: usize = 500;
const MAX_FUNCTION_LINES: usize = 70;
const FOLDERS: [&str; 7] = ["src", "tests", "schemas", "recorder", "replayer", "slam", "fixtures"];

fn files() -> Vec<(PathBuf, String)> {
    let all = FOLDERS.iter().flat_map(|folder| rust_files(&root().join(folder)));
    all.map(|path| (path.clone(), fs::read_to_string(path).unwrap())).collect()
}

/// Functions with their first line and length. Formatted code closes a function with its own indentation.
fn functions(text: &str) -> Vec<(usize, usize)> {
    let lines: Vec<&str> = text.lines().collect();
    let mut found = Vec::new();
    for (first, line) in lines.iter().enumerate() {
        let code = line.trim_start();
        let indentation = &line[..line.len() - code.len()];
        let words = ["fn ", "pub fn ", "pub(crate) fn ", "pub(super) fn ", "const fn ", "pub const fn ", "unsafe fn "];
        if !words.iter().any(|word| code.starts_with(word)) || code.ends_with(';') || code.ends_with('}') {
            continue;
        }
        let close = format!("{indentation}}}");
        let length = lines[first..].iter().position(|line| *line == close).map_or(0, |at| at + 1);
        found.push((first + 1, length));
    }
    found
}

#[test]
fn files_and_functions_are_short() {
    let files = files();
    assert!(files.len() > 100, "only {} files found", files.len());
    for (path, text) in files {
        let lines = text.lines().count();
        assert!(lines <= MAX_FILE_LINES, "{}: {lines} lines, at most {MAX_FILE_LINES}", path.display());
        for (line, length) in functions(&text) {
            let name = path.display();
            assert!(length <= MAX_FUNCTION_LINES, "{name} line {line}: {length} lines, at most {MAX_FUNCTION_LINES}");
        }
    }
}

#[test]
fn the_measure_works() {
    let body = "    let x = 1;\n".repeat(80);
    assert_eq!(functions(&format!("mod m {{\npub fn long() {{\n{body}}}\n}}\n")), [(2, 82)]);
}

#[test]
fn nothing_is_left_undone() {
    // In pieces, so that this file passes its own test.
    let banned = [["todo", "!("], ["unimplemented", "!("], ["#[ig", "nore"], ["dbg", "!("]].map(|parts| parts.concat());
    for (path, text) in files() {
        for word in &banned {
            assert!(!text.contains(word.as_str()), "{}: {word}", path.display());
        }
    }
}

#[test]
fn the_house_is_complete() {
    for name in
        ["README.md", "ARCHITECTURE.md", "STYLE.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE", "deny.toml"]
    {
        assert!(root().join(name).is_file(), "{name} is missing");
    }
    let changelog = fs::read_to_string(root().join("CHANGELOG.md")).unwrap();
    let first = changelog.lines().find(|line| line.starts_with("## "));
    assert_eq!(first, Some("## Unreleased"), "CHANGELOG.md has its unreleased section on top");
}
