//! Files that an operator names: reading their text, and saying in words why one cannot be read or written.

use std::io::{self, ErrorKind, Read};
use std::path::Path;

use super::diagnostic::{Diagnostics, Severity};

/// Largest settings file that is read, in bytes.
pub(crate) const MAX_BYTES: u64 = 1 << 20;

/// The text of a file of at most `max_bytes`.
///
/// # Errors
/// It is missing, not a file, unreadable, too large, or not UTF-8.
pub(crate) fn read_text(path: &Path, max_bytes: u64) -> Result<String, Diagnostics> {
    let name = path.display().to_string();
    let file = std::fs::File::open(path).and_then(|file| match file.metadata()?.is_dir() {
        true => Err(ErrorKind::IsADirectory.into()),
        false => Ok(file),
    });
    text_of(&name, file, max_bytes)
}

/// The text of whatever can be read, by the name it has in messages.
///
/// # Errors
/// As [`read_text`].
pub(crate) fn text_of(
    name: &str,
    source: io::Result<impl Read>,
    max_bytes: u64,
) -> Result<String, Diagnostics> {
    let mut bytes = Vec::new();
    match source.and_then(|source| source.take(max_bytes + 1).read_to_end(&mut bytes)) {
        Err(error) => {
            let (what, help) = unreadable(&error);
            Err(Diagnostics::of_file(name, format!("cannot be read: {what}"), help))
        }
        Ok(_) if bytes.len() as u64 > max_bytes => Err(Diagnostics::of_file(
            name,
            format!("the file is larger than {max_bytes} bytes"),
            "give the file itself; missions are a few kilobytes, plans a few for each slot",
        )),
        Ok(_) => String::from_utf8(bytes).map(without_mark).map_err(|error| not_text(name, &error)),
    }
}

/// A byte order mark is the editor's, not the operator's.
fn without_mark(mut text: String) -> String {
    if text.starts_with('\u{feff}') {
        text.drain(..'\u{feff}'.len_utf8());
    }
    text
}

fn not_text(name: &str, error: &std::string::FromUtf8Error) -> Diagnostics {
    let offset = error.utf8_error().valid_up_to();
    let byte = error.as_bytes().get(offset).copied().unwrap_or_default();
    let valid = String::from_utf8_lossy(&error.as_bytes()[..offset]).into_owned();
    let mut all = Diagnostics::new(name, valid.into());
    let message = format!("the file is not UTF-8 text: byte {byte:#04x} at offset {offset}");
    let help = "save the file as UTF-8, or give a text file".to_owned();
    all.push(Severity::Error, offset..offset, message, help);
    all
}

/// Why a file cannot be read, and the remedy.
fn unreadable(error: &io::Error) -> (String, &'static str) {
    let (what, help) = match error.kind() {
        ErrorKind::NotFound => ("there is no such file", "check the path; examples are in config/"),
        ErrorKind::IsADirectory => ("this is a directory", "give the path of a file inside it"),
        ErrorKind::PermissionDenied => ("permission to read it is denied", "check its mode and owner"),
        ErrorKind::NotADirectory => ("a part of its path is a file, not a directory", "check the path"),
        _ => return (error.to_string(), "give the path of a readable file"),
    };
    (what.to_owned(), help)
}

/// Why `path` cannot be written (or made, if it is a directory), and the remedy, in one line.
pub(crate) fn unwritable(path: &Path, error: &io::Error) -> String {
    let elsewhere = "give a directory in which files can be made";
    let (what, help) = match error.kind() {
        ErrorKind::NotFound => ("there is no such directory, and it cannot be made", elsewhere),
        ErrorKind::NotADirectory => ("a part of its path is a file, not a directory", elsewhere),
        ErrorKind::AlreadyExists => ("there is a file of that name", "give another name, or move the file"),
        ErrorKind::IsADirectory => ("there is a directory of that name", "give another name"),
        ErrorKind::PermissionDenied => ("permission is denied", "check mode and owner, or write elsewhere"),
        ErrorKind::ReadOnlyFilesystem => ("the file system is read-only", elsewhere),
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            ("the disk is full", "make room, or write elsewhere")
        }
        _ => return format!("cannot write {}: {error}; {elsewhere}", path.display()),
    };
    format!("cannot write {}: {what}; {help}", path.display())
}

/// Makes the directory if it is not there, and sees that a file can be made in it.
///
/// # Errors
/// It cannot be, in words.
pub(crate) fn usable_directory(path: &Path) -> Result<(), String> {
    let probe = path.join(format!(".veilwing-{}", std::process::id()));
    std::fs::create_dir_all(path)
        .and_then(|()| std::fs::write(&probe, b""))
        .and_then(|()| std::fs::remove_file(&probe))
        .map_err(|error| unwritable(path, &error))
}

/// Writes a file whole or not at all: an earlier one of that name is kept until the new one is complete.
///
/// # Errors
/// It cannot be, in words.
pub(crate) fn write_whole(path: &Path, content: impl AsRef<[u8]>) -> Result<(), String> {
    let mut beside = path.as_os_str().to_owned();
    beside.push(format!(".{}", std::process::id()));
    let beside = Path::new(&beside);
    let written = std::fs::write(beside, content).and_then(|()| std::fs::rename(beside, path));
    written.map_err(|error| {
        // It may not be there at all.
        let _ = std::fs::remove_file(beside);
        unwritable(path, &error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spec_a_file_that_cannot_be_written_is_told_with_its_remedy() {
        let directory = std::env::temp_dir().join(format!("veilwing-file-{}", std::process::id()));
        assert_eq!(usable_directory(&directory), Ok(()));
        let path = directory.join("plan.json");
        assert_eq!(write_whole(&path, "old"), Ok(()));
        assert_eq!(write_whole(&path, "new"), Ok(()));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        // Neither the probe nor the file beside it is left.
        assert_eq!(std::fs::read_dir(&directory).unwrap().count(), 1);
        for (wrong, says) in [
            (usable_directory(&path), "there is a file of that name; give another name"),
            (usable_directory(&path.join("under")), "a part of its path is a file, not a directory; give"),
            (usable_directory(Path::new("/proc/nope")), "no such directory, and it cannot be made; give"),
            (write_whole(&directory, "over a directory"), "there is a directory of that name; give"),
        ] {
            let message = wrong.unwrap_err();
            assert!(message.contains(says), "{says:?} is not in {message:?}");
        }
        std::fs::remove_dir_all(&directory).unwrap();
    }
}
