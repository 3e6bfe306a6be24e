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
    let read = || -> io::Result<String> {
        let mut text = String::new();
        File::open(file)?.take(MAX_BYTES + 1).read_to_string(&mut text)?;
        Ok(text)
    };
    let failed = |why: String| Failure::failed(why).at(file.display()).hint(hint);
    match read() {
        Ok(text) if text.len() as u64 > MAX_BYTES => Err(failed(format!("is longer than {} MiB", MAX_BYTES >> 20))),
        Ok(text) => Ok(text),
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
        std::fs::write(&file, [0xff, 0xfe]).unwrap();
        for place in [&file, &folder.path().to_owned()] {
            let line = read_text(place, "name another").unwrap_err().line().unwrap();
            let start = format!("error: {}: cannot be read: ", place.display());
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
