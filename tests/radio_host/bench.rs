//! `radio measure` and `radio calibrate`, with programs for a device.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::backends::directory;

/// A radio file whose device keeps its state in the file's directory.
fn radio_file(directory: &Path) -> PathBuf {
    let at = directory.display();
    let text = format!(
        "[radio]\nsystem_id = 1\n[link]\naddress = \"udpin:127.0.0.1:14570\"\n\
         [device]\nkind = \"command\"\nleast = 0\nmost = 4\nfrequency_hz = 915e6\noff_ms = 500\nchange_ms = 500\n\
         [calibration]\nfile = \"measured.csv\"\n\
         [command]\nset = [\"sh\", \"-c\", \"echo $1 > $0/power\", \"{at}\", \"{{level}}\"]\nread = [\"cat\", \"{at}/power\"]\n\
         off = [\"sh\", \"-c\", \"echo off > $0/power\", \"{at}\"]\n"
    );
    let file = directory.join("radio.toml");
    std::fs::write(&file, text).unwrap();
    file
}

fn radio(arguments: &[&str], file: &Path, input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_veilwing"))
        .arg("radio")
        .args(arguments)
        .arg(file)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It may not want all of it.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn spec_a_calibration_asks_refuses_what_is_out_of_order_and_is_never_written_over() {
    let path = directory("calibrate");
    let (file, csv) = (radio_file(&path), path.join("measured.csv"));
    let unasked = radio(&["calibrate"], &file, "");
    assert!(unasked.status.code() == Some(2) && said(&unasked).contains("--radiate"), "{}", said(&unasked));
    let cut_short = radio(&["calibrate", "--radiate"], &file, "1\n2\n");
    assert!(cut_short.status.code() == Some(2) && !csv.exists(), "{}", said(&cut_short));
    let done = radio(
        &["calibrate", "--radiate"],
        &file,
        "1.5\n2,5\n0.5\n2.25\nback\n2.5\n2.25\n3.75\n5\nNaN\n6.125\n",
    );
    assert_eq!(done.status.code(), Some(0), "{}", said(&done));
    assert!(
        said(&done).contains("\"2,5\" is no number") && said(&done).contains("2.25 dBm breaks the order")
    );
    // A slip makes all that follows out of order, and can be taken back.
    assert_eq!(said(&done).matches("setting 1, read back as 1").count(), 3, "{}", said(&done));
    let written = std::fs::read_to_string(&csv).unwrap();
    let rows = "frequency_hz,setting,dbm\n915000000,0,1.5\n915000000,1,2.5\n915000000,2,3.75\n915000000,3,5\n915000000,4,6.125\n";
    assert_eq!(written, rows);
    assert_eq!(std::fs::read_to_string(path.join("power")).unwrap(), "off\n");
    let again = radio(&["calibrate", "--radiate"], &file, "");
    assert!(again.status.code() == Some(2) && said(&again).contains("is there already"), "{}", said(&again));
    std::fs::remove_dir_all(path).unwrap();
}

#[test]
fn spec_times_are_measured_and_printed_as_a_table() {
    let path = directory("measure");
    let file = radio_file(&path);
    std::fs::write(path.join("measured.csv"), "frequency_hz,setting,dbm\n915e6,0,1\n915e6,4,5\n").unwrap();
    let done = radio(&["measure", "--radiate", "--times", "3"], &file, "");
    assert_eq!(done.status.code(), Some(0), "{}", said(&done));
    let table = String::from_utf8(done.stdout).unwrap();
    let rows: Vec<Vec<f64>> = table
        .lines()
        .filter(|line| line.contains("read back"))
        .map(|line| line.split_whitespace().filter_map(|word| word.parse().ok()).collect())
        .collect();
    assert_eq!(rows.len(), 3, "{table}");
    for row in rows {
        assert!(row.len() == 4 && row[0] > 0.0 && row.is_sorted(), "{table}");
    }
    assert!(table.contains("change_ms = ") && table.contains("off_ms = "), "{table}");
    assert_eq!(std::fs::read_to_string(path.join("power")).unwrap(), "off\n");
    std::fs::remove_dir_all(path).unwrap();
}
