//! `CITATION.cff` in the Citation File Format 1.2.0.

use super::Card;

impl Card<'_> {
    pub(super) fn citation(&mut self) -> String {
        let options = self.options;
        let mut text = String::from("cff-version: 1.2.0\nmessage: If you use this dataset, please cite it as below.\n");
        text += &format!("type: dataset\ntitle: {}\nauthors:\n", quoted(&self.title));
        if options.authors.is_empty() {
            self.to_fill_in.push("authors (CITATION.cff, croissant.json; or --author)".to_owned());
            text += "  - name: FILL IN\n";
        }
        for author in &options.authors {
            text += &format!("  - name: {}\n", quoted(author));
        }
        text += &format!("version: {}\n", quoted(self.version()));
        let given = [("date-released", &options.date), ("license", &options.license), ("url", &options.url)];
        for (key, value) in given {
            if let Some(value) = value {
                text += &format!("{key}: {}\n", quoted(value));
            }
        }
        text
    }

    pub(super) fn version(&self) -> &str {
        self.options.version.as_deref().unwrap_or("1.0.0")
    }
}

/// A YAML string; JSON's are such.
pub(super) fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
