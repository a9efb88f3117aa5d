//! `pslam sim` and `pslam devices` together.

use crate::support::{pslam_exits, text};
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};

/// A running system, ended with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a system; gives its address.
fn start(arguments: &[&str]) -> (Running, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
    let child = command.arg("sim").args(arguments).args(["--listen", "127.0.0.1:0"]).stdout(Stdio::piped()).spawn();
    let mut running = Running(child.unwrap());
    let mut line = String::new();
    BufReader::new(running.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let address = line.split_whitespace().nth(1).unwrap_or_else(|| panic!("no address in `{line}`"));
    (running, address.to_owned())
}

#[test]
fn devices_lists_the_subjects_of_a_simulated_system() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("path.txt");
    let rows: Vec<String> = (0..=200).map(|k| format!("{} {} 0 1 0 0 0 1", 5.0 + f64::from(k) * 0.02, k)).collect();
    fs::write(&file, rows.join("\n")).unwrap();
    let other = format!("person={}", text(&file));
    let subjects = ["--subject", "quad", "--subject", &other, "--loop"];
    for (protocol, option, prefix) in [("vicon", "--vicon", ""), ("vrpn", "--vrpn", "tcp://")] {
        let (_running, address) = start(&[&[protocol, "synthetic:tiny"][..], &subjects].concat());
        let address = format!("{prefix}{address}");
        let found = pslam_exits(0, &["devices", option, &address, "--wait", "0.5", "--json"]);
        let found: serde_json::Value = serde_json::from_str(&found).unwrap();
        let system = &found["mocap"][0];
        let bodies = system["bodies"].as_array().unwrap();
        let names: Vec<&str> = bodies.iter().map(|body| body["subject"].as_str().unwrap()).collect();
        assert_eq!(names, ["quad", "person"]);
        assert!(bodies.iter().all(|body| body["seen_frames"].as_u64().unwrap() > 5), "{found}");
        if protocol == "vicon" {
            assert_eq!(system["rate_hz"].as_f64(), Some(100.0));
            assert_eq!(system["lost_frames"].as_u64(), Some(0));
            let listed = pslam_exits(0, &["devices", option, &address, "--wait", "0.3"]);
            assert!(listed.contains("  person/person: seen in 100 %, quality 0.95"), "{listed}");
        }
    }
}

#[test]
fn requests_that_make_no_sense() {
    pslam_exits(2, &["sim", "vicon", "synthetic:nowhere", "--subject", "a"]);
    pslam_exits(2, &["sim", "vicon", "synthetic:tiny"]);
    pslam_exits(2, &["sim", "vicon", "synthetic:tiny", "--subject", "a", "--subject", "a"]);
    pslam_exits(2, &["sim", "vicon", "synthetic:tiny", "--subject", "a", "--fault", "nothing"]);
    pslam_exits(2, &["sim", "udp", "synthetic:tiny", "--subject", "a", "--fault", "y-up"]);
    pslam_exits(2, &["sim", "vicon", "synthetic:tiny", "--subject", "a", "--marker-from-camera", "0,0,0,0,0,0,2"]);
    pslam_exits(3, &["sim", "vicon", "/nowhere.txt", "--subject", "a"]);
    // Nobody listens on port 1.
    pslam_exits(3, &["devices", "--vicon", "127.0.0.1:1"]);
}
