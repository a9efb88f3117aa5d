//! `croissant.json`: the Croissant format 1.0 of MLCommons (JSON-LD), with one record a frame.

use serde_json::{Value, json};

use super::{Card, SharedFile};

/// Columns of `frames.csv`: name, type, what it is.
const COLUMNS: [(&str, &str, &str); 6] = [
    ("log", "sc:Text", "file of the log"),
    ("index", "sc:Integer", "position of the frame in the log, from 0"),
    ("stamp_ns", "sc:Integer", "time of the colour picture, nanoseconds on the log's timeline"),
    ("has_depth", "sc:Boolean", "whether a depth image belongs to it"),
    ("has_right", "sc:Boolean", "whether a right picture belongs to it"),
    ("has_mask", "sc:Boolean", "whether the default segmentation layer has a mask for it"),
];

impl Card<'_> {
    pub(super) fn croissant(&self) -> String {
        let options = self.options;
        let creators = options.authors.iter().map(|name| json!({"@type": "sc:Organization", "name": name}));
        let mut creators: Vec<Value> = creators.collect();
        if creators.is_empty() {
            creators.push(json!({"@type": "sc:Organization", "name": "FILL IN"}));
        }
        let mut value = json!({
            "@context": context(),
            "@type": "sc:Dataset",
            "name": identifier(&self.title),
            "alternateName": self.title,
            "description": self.description(),
            "conformsTo": "http://mlcommons.org/croissant/1.0",
            "license": options.license.as_deref().unwrap_or("FILL IN"),
            "url": options.url.as_deref().unwrap_or("https://example.org/FILL-IN"),
            "version": self.version(),
            "creator": creators,
            "citeAs": format!("{}. {}, version {}.", self.authors(), self.title, self.version()),
            "keywords": self.tags(),
            "distribution": self.files.iter().filter(|file| file.path != "LICENSE").map(file_object).collect::<Vec<_>>(),
            "recordSet": [{
                "@type": "cr:RecordSet", "@id": "frames", "name": "frames",
                "description": "The frames of all logs; their pictures stand in the logs.",
                "field": COLUMNS.iter().map(field).collect::<Vec<_>>(),
            }],
        });
        if let Some(date) = &options.date {
            value["datePublished"] = json!(date);
        }
        format!("{value:#}\n")
    }

    pub(super) fn authors(&self) -> String {
        if self.options.authors.is_empty() { "FILL IN".to_owned() } else { self.options.authors.join(", ") }
    }
}

fn file_object(file: &SharedFile) -> Value {
    let kind = match file.path.rsplit('.').next() {
        Some("mcap") => "application/octet-stream",
        Some("png") => "image/png",
        Some("csv") => "text/csv",
        _ => "application/json",
    };
    json!({
        "@type": "cr:FileObject", "@id": file.path, "name": file.path, "contentUrl": file.path,
        "contentSize": format!("{} B", file.bytes), "encodingFormat": kind, "sha256": file.sha256,
    })
}

fn field((name, kind, what): &(&str, &str, &str)) -> Value {
    json!({
        "@type": "cr:Field", "@id": format!("frames/{name}"), "name": name, "description": what, "dataType": kind,
        "source": {"fileObject": {"@id": "frames.csv"}, "extract": {"column": name}},
    })
}

/// A name without characters that file systems or URLs dislike.
fn identifier(title: &str) -> String {
    let known = |c: char| if c.is_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    title.chars().map(known).collect()
}

/// The context that the specification gives.
fn context() -> Value {
    json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "citeAs": "cr:citeAs",
        "column": "cr:column",
        "conformsTo": "dct:conformsTo",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "data": {"@id": "cr:data", "@type": "@json"},
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "dct": "http://purl.org/dc/terms/",
        "equivalentProperty": "cr:equivalentProperty",
        "examples": {"@id": "cr:examples", "@type": "@json"},
        "extract": "cr:extract",
        "field": "cr:field",
        "fileProperty": "cr:fileProperty",
        "fileObject": "cr:fileObject",
        "fileSet": "cr:fileSet",
        "format": "cr:format",
        "includes": "cr:includes",
        "isLiveDataset": "cr:isLiveDataset",
        "jsonPath": "cr:jsonPath",
        "key": "cr:key",
        "md5": "cr:md5",
        "parentField": "cr:parentField",
        "path": "cr:path",
        "recordSet": "cr:recordSet",
        "references": "cr:references",
        "regex": "cr:regex",
        "repeated": "cr:repeated",
        "replace": "cr:replace",
        "samplingRate": "cr:samplingRate",
        "sc": "https://schema.org/",
        "separator": "cr:separator",
        "source": "cr:source",
        "subField": "cr:subField",
        "transform": "cr:transform",
    })
}
