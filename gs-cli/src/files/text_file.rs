//! Text files that the user wrote: settings, studies, camera paths. They may come through a pipe,
//! but not without end.

use std::{
    fs::File,
    io::{self, Read},
    path::Path,
};

use crate::failure::Failure;

/// The longest text that is read, bytes. A camera path of 100,000 keys has about 10 MB.
const MAX_BYTES: u64 = 64 << 20;

/// Reads a text file; `hint` says what to do if the file does not exist.
pub(crate) fn read_text(file: &Path, hint: &str) -> Result<String, Failure> {
    let read = || -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        File::open(file)?.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
        Ok(bytes)
    };
    let failed = |why: String| Failure::failed(why).at(file.display()).hint(hint);
    match read() {
        Ok(bytes) if bytes.len() as u64 > MAX_BYTES => Err(failed(format!("is longer than {} MiB", MAX_BYTES >> 20))),
        Ok(bytes) => match str::from_utf8(gs_io::utf8_text(file, &bytes)?) {
            Ok(text) => Ok(text.to_owned()),
            Err(error) => Err(failed(format!("is not text in UTF-8: {error}"))),
        },
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            Err(gs_io::Error::Missing { path: file.to_owned() }.into())
        }
        Err(error) => Err(failed(format!("cannot be read: {error}"))),
    }
}

/// Reads the text of a settings file. It must be read only once: it may be a pipe.
pub(crate) fn read_settings_text(file: &Path) -> Result<String, Failure> {
    read_text(file, "name a file of settings")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_read_and_anything_else_is_refused_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.toml");
        std::fs::write(&file, "a = 1\n").unwrap();
        assert_eq!(read_text(&file, "name another").unwrap(), "a = 1\n");
        std::fs::write(&file, "\u{feff}a = 1\n").unwrap();
        assert_eq!(read_text(&file, "name another").unwrap(), "a = 1\n", "a byte-order mark is skipped");
        std::fs::write(&file, [0xff, 0xfe, b'a', 0]).unwrap();
        let line = read_text(&file, "name another").unwrap_err().line().unwrap();
        assert!(line.contains("a.toml: is text in UTF-16, but must be in UTF-8"), "{line}");
        std::fs::write(&file, [0xff, b'a']).unwrap();
        for (place, why) in [(&file, "is not text in UTF-8"), (&folder.path().to_owned(), "cannot be read")] {
            let line = read_text(place, "name another").unwrap_err().line().unwrap();
            let start = format!("error: {}: {why}: ", place.display());
            assert!(line.starts_with(&start) && line.ends_with(": name another"), "{line}");
        }
        let line = read_text(&folder.path().join("absent"), "name another").unwrap_err().line().unwrap();
        assert!(line.ends_with("absent: no such file; check the path"), "{line}");
    }

    #[test]
    #[cfg(unix)]
    fn a_file_that_never_ends_is_refused() {
        let line = read_text(Path::new("/dev/zero"), "name another").unwrap_err().line().unwrap();
        assert_eq!(line, "error: /dev/zero: is longer than 64 MiB: name another");
    }
}
