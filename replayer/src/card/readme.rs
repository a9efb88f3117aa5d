//! The `README.md`: YAML front matter as dataset hubs read it, then everything in words.

use std::fmt::Write as _;

use super::citation::quoted;
use super::{Card, LogStatistics};

/// Classes that a table shows.
const MOST_CLASSES: usize = 12;

impl Card<'_> {
    pub(super) fn readme(&mut self) -> String {
        let mut text = self.front_matter();
        let _ = write!(text, "\n# {}\n\n{}\n", self.title, self.description());
        text += "\n## Contents\n\n";
        text += &self.contents();
        text += &self.pictures();
        text += &self.statistics();
        text += &self.conventions();
        text += &self.clocks();
        text += &self.issues();
        text += &self.people();
        text += &self.citing();
        let to_do: String = self.to_fill_in.iter().map(|what| format!("- [ ] {what}\n")).collect();
        if !to_do.is_empty() {
            let _ = write!(text, "\n## Before publishing\n\nFill in, then renew `SHA256SUMS`:\n\n{to_do}");
        }
        text
    }

    fn front_matter(&mut self) -> String {
        let license = match &self.options.license {
            Some(id) => {
                if self.options.license_file.is_none() {
                    self.to_fill_in.push("the text of the licence (LICENSE; or --license-file)".to_owned());
                }
                id.to_lowercase()
            }
            None => {
                self.to_fill_in.push("the licence (LICENSE, README.md, croissant.json; or --license)".to_owned());
                "other".to_owned()
            }
        };
        if self.options.url.is_none() {
            self.to_fill_in.push("the address (croissant.json; or --url)".to_owned());
        }
        let frames: usize = self.logs.iter().map(|log| log.frames).sum();
        let size = match frames {
            0..1_000 => "n<1K",
            1_000..10_000 => "1K<n<10K",
            10_000..100_000 => "10K<n<100K",
            100_000..1_000_000 => "100K<n<1M",
            _ => "n>1M",
        };
        let list = |items: &[&str]| items.iter().map(|item| format!("- {item}\n")).collect::<String>();
        let mut tasks = vec!["robotics"];
        if self.logs.iter().any(|log| log.frames_with_depth > 0) {
            tasks.push("depth-estimation");
        }
        if self.logs.iter().any(|log| !log.masks.is_empty()) {
            tasks.push("image-segmentation");
        }
        format!(
            "---\nlicense: {license}\ntask_categories:\n{}tags:\n{}size_categories:\n- {size}\npretty_name: {}\n---\n",
            list(&tasks),
            list(&self.tags()),
            quoted(&self.title),
        )
    }

    pub(super) fn tags(&self) -> Vec<&'static str> {
        let has = |of: &dyn Fn(&LogStatistics) -> bool| self.logs.iter().any(of);
        let known = [
            ("slam", true),
            ("visual-odometry", true),
            ("mcap", true),
            ("ros2", true),
            ("rgbd", has(&|log| log.camera_kind == "rgbd")),
            ("stereo", has(&|log| log.camera_kind == "stereo")),
            ("monocular", has(&|log| log.camera_kind == "monocular")),
            ("imu", has(&|log| log.inertial_messages > 0)),
            ("ground-truth", has(&|log| log.ground_truth_poses > 0)),
            ("panoptic-segmentation", has(&|log| !log.masks.is_empty())),
        ];
        known.into_iter().filter(|(_, holds)| *holds).map(|(tag, _)| tag).collect()
    }

    pub(super) fn description(&self) -> String {
        if let Some(text) = &self.options.description {
            return text.clone();
        }
        let frames: usize = self.logs.iter().map(|log| log.frames).sum();
        let seconds: f64 = self.logs.iter().map(|log| log.duration_s).sum();
        let mut kinds: Vec<&str> = self.logs.iter().map(|log| log.camera_kind).collect();
        kinds.sort_unstable();
        kinds.dedup();
        let count = self.logs.len();
        let logs = if count == 1 { "log" } else { "logs" };
        format!("{count} {logs} of a moving camera ({}), {frames} frames in {seconds:.0} s.", kinds.join(", "))
    }

    fn contents(&self) -> String {
        let mut text = String::from("| file | what it is |\n|---|---|\n");
        for log in self.logs {
            let _ = writeln!(text, "| `{}` | MCAP, ROS 2 messages, {} frames |", log.file, log.frames);
        }
        text += "| `frames.csv` | one line a frame: stamp, and what belongs to it |\n| `statistics.json` | the numbers \
                 below and more |\n| `preview/` | contact sheets |\n| `croissant.json` | Croissant 1.0 metadata |\n| \
                 `CITATION.cff`, `LICENSE` | how to cite, and what is allowed |\n| `SHA256SUMS` | `sha256sum -c SHA256SUMS` |\n\n\
                 Logs open in Rerun, Foxglove and any MCAP or `rosbags` reader. `pslam export tum|euroc|rosbag2|png|coco-panoptic LOG \
                 -o FOLDER` turns one into folders of pictures.\n";
        text
    }

    fn pictures(&self) -> String {
        let mut text =
            String::from("\n## Pictures\n\nPictures, depth (red is near, blue far, black unknown) and labels.\n");
        for log in self.logs {
            let _ = write!(text, "\n`{}`\n\n![{}]({})\n", log.file, log.file, log.contact_sheet);
        }
        text
    }

    fn statistics(&self) -> String {
        let mut text = String::from(
            "\n## Statistics\n\n| log | camera | size | s | frames | Hz | largest gap, s | depth pixels | masks | path, m | \
             mean / top m/s |\n|---|---|---|---|---|---|---|---|---|---|---|\n",
        );
        for log in self.logs {
            let [width, height] = log.picture_size;
            let depth = log.depth_coverage.map_or("-".to_owned(), |share| format!("{:.1} %", share * 100.0));
            let masks: usize = log.masks.values().sum();
            let (path, speed) = if log.ground_truth_poses > 0 {
                (format!("{:.2}", log.path_m), format!("{:.2} / {:.2}", log.mean_speed_m_s, log.top_speed_m_s))
            } else {
                ("-".to_owned(), "-".to_owned())
            };
            let _ = writeln!(
                text,
                "| `{}` | {} | {width}x{height} | {:.2} | {} | {:.2} | {:.3} | {depth} | {masks} | {path} | {speed} |",
                log.file, log.camera_kind, log.duration_s, log.frames, log.rate_hz, log.largest_gap_s,
            );
        }
        for log in self.logs.iter().filter(|log| !log.classes.is_empty()) {
            let _ = write!(
                text,
                "\n`{}`: share of pixels by class\n\n| class | share | frames |\n|---|---|---|\n",
                log.file
            );
            for class in log.classes.iter().take(MOST_CLASSES) {
                let _ = writeln!(text, "| {} | {:.2} % | {} |", class.name, class.share * 100.0, class.frames);
            }
            let more = log.classes.len().saturating_sub(MOST_CLASSES);
            if more > 0 {
                let _ = writeln!(text, "\nand {more} more in `statistics.json`.");
            }
        }
        text
    }

    fn conventions(&self) -> String {
        let mut text = String::from(
            "\n## Frames and units\n\nMetres, radians, seconds; quaternions are x y z w. Camera frames: x right, y down, z \
             forward, pixel centres at whole numbers. A pose is world_from_camera. Depth is along z, 0 = no measurement. \
             Class and instance 0 mean unknown, not background.\n",
        );
        let mut told: Vec<&LogStatistics> = Vec::new();
        for log in self.logs {
            let same = told.iter().find(|earlier| earlier.conventions == log.conventions);
            match same {
                Some(earlier) => {
                    let _ = write!(
                        text,
                        "\n`{}` ({}) says the same of itself as `{}`.\n\n",
                        log.file, log.source, earlier.file
                    );
                }
                None => {
                    let _ = write!(text, "\n`{}` ({}) says of itself:\n\n", log.file, log.source);
                    for (key, value) in &log.conventions {
                        let _ = writeln!(text, "- {key}: {value}");
                    }
                    told.push(log);
                }
            }
            if let Some(units) = log.depth_units_per_metre {
                let _ = writeln!(text, "- depth values of one metre: {units}");
            }
            let origin = log.ground_truth_origin.as_deref().unwrap_or("none");
            let _ = writeln!(text, "- ground truth: {origin}, {} poses", log.ground_truth_poses);
        }
        text
    }

    fn clocks(&self) -> String {
        let mut text = String::from(
            "\n## Clocks\n\nStamps are whole nanoseconds and never rewritten. In a recording they are the device's own times on \
             the host's timeline; in an import they are those of the source.\n\n",
        );
        for log in self.logs {
            let Some(sync) = &log.sync else {
                let _ = writeln!(
                    text,
                    "- `{}`: no record of clock offsets or of a hand-eye transform in the log",
                    log.file
                );
                continue;
            };
            let number =
                |value: Option<f64>, unit: &str| value.map_or("not known".to_owned(), |v| format!("{v:.3} {unit}"));
            let residual =
                sync.hand_eye_residual.map_or("not known".to_owned(), |[deg, mm]| format!("{deg:.3} deg, {mm:.2} mm"));
            let _ = writeln!(
                text,
                "- `{}`: mocap minus camera {} (standard deviation {}), drift {}, hand-eye residual {residual}; {}",
                log.file,
                number(sync.clock_offset_ms, "ms"),
                number(sync.clock_offset_sigma_ms, "ms"),
                number(sync.clock_drift_ppm, "ppm"),
                sync.method,
            );
        }
        text
    }

    fn issues(&self) -> String {
        let mut text =
            String::from("\n## Known issues\n\nWhat `pslam check` finds, losses while recording included:\n\n");
        for log in self.logs {
            if log.known_issues.is_empty() {
                let _ = writeln!(text, "- `{}`: none", log.file);
            }
            for issue in &log.known_issues {
                let _ = writeln!(text, "- `{}`: {issue}", log.file);
            }
            for edit in &log.edits {
                let _ = writeln!(text, "- `{}` was edited: {edit}", log.file);
            }
        }
        text
    }

    fn people(&mut self) -> String {
        let mut text = String::from("\n## People and consent\n\n");
        for log in self.logs {
            let person = log.classes.iter().find(|class| class.name == schemas::panoptic::PERSON);
            let seen = match person {
                Some(class) => format!("the labels show people in {} of {} frames", class.frames, log.frames),
                None if log.classes.is_empty() => {
                    "there are no labels that would tell whether people are visible".to_owned()
                }
                None => "the labels show no people".to_owned(),
            };
            let _ = writeln!(text, "- `{}`: {seen}; {}", log.file, redacted(log));
        }
        let exposed = |log: &&LogStatistics| {
            log.redaction.is_none() && log.classes.iter().any(|class| class.name == schemas::panoptic::PERSON)
        };
        for log in self.logs.iter().filter(exposed) {
            self.to_fill_in
                .push(format!("people are labelled in {}, which is not redacted: see `pslam redact`", log.file));
        }
        text += "\nFILL IN: who is visible or audible, how they agreed to publication (form, date, scope, withdrawal), which ethics \
                 board or data protection office decided what, and whom to ask for removal.\n";
        self.to_fill_in.push("the statement on people and consent (README.md)".to_owned());
        text
    }

    fn citing(&self) -> String {
        let license = match &self.options.license {
            Some(id) => format!("Licence: {id}, see `LICENSE`."),
            None => "Licence: FILL IN, see `LICENSE`.".to_owned(),
        };
        format!("\n## Licence and citation\n\n{license} Cite as `CITATION.cff` says.\n")
    }
}

/// What the log's own audit record says.
fn redacted(log: &LogStatistics) -> String {
    let Some(record) = &log.redaction else { return "the log was not redacted by `pslam redact`".to_owned() };
    let word = |key: &str| record.get(key).map_or("?", String::as_str);
    format!(
        "redacted by `pslam redact`: {} of layer {}, method {}, {} of {} frames; doubtful frames and pixel counts stand in the \
         log's record `{}`",
        word("classes"),
        word("layer"),
        word("method"),
        word("frames_redacted"),
        word("frames"),
        schemas::metadata::REDACTION,
    )
}
