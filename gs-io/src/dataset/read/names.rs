//! Names of files as data sets write them, and how they are compared.

use unicode_normalization::UnicodeNormalization;

/// Extensions of images, in the order in which they are tried if a name has none or its file does
/// not exist.
pub(crate) const EXTENSIONS: [&str; 12] =
    ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG", "webp", "tif", "tiff", "bmp", "ppm", "gif"];

/// A path with `/` between its parts and without `.` among them: `images/0.png` for `.\images\0.png`.
pub(crate) fn plain(name: &str) -> String {
    if name.starts_with(r"\\") {
        return name.to_owned();
    }
    let parts = name.split(['/', '\\']).enumerate();
    let kept: Vec<&str> =
        parts.filter(|(i, part)| !(*part == "." || part.is_empty() && *i > 0)).map(|(_, part)| part).collect();
    kept.join("/")
}

/// The form of a name in which names are compared that differ in letter case, Unicode normalization
/// or separators.
pub(crate) fn folded(name: &str) -> String {
    plain(name).to_lowercase().nfc().collect()
}

/// The name without the extension of an image, if it has one.
pub(crate) fn without_extension(name: &str) -> &str {
    match name.rsplit_once('.') {
        Some((stem, extension)) if EXTENSIONS.iter().any(|known| known.eq_ignore_ascii_case(extension)) => stem,
        _ => name,
    }
}

/// Whether a path begins with the drive of Windows, or is in a network folder: `C:\a.png`,
/// `\\server\a.png`.
pub(crate) fn is_windows_absolute(name: &str) -> bool {
    let mut letters = name.chars();
    let drive = letters.next().is_some_and(|letter| letter.is_ascii_alphabetic()) && letters.next() == Some(':');
    drive && matches!(letters.next(), None | Some('/' | '\\')) || name.starts_with('\\')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_paths_become_plain() {
        for (name, expected) in [
            (".\\images\\00.png", "images/00.png"),
            ("images\\00.png", "images/00.png"),
            ("./images//00.png", "images/00.png"),
            ("images/./a b/00.png", "images/a b/00.png"),
            ("..\\a", "../a"),
            ("/a/b", "/a/b"),
            ("r_0.5", "r_0.5"),
            (r"\\server\a.png", r"\\server\a.png"),
        ] {
            assert_eq!(plain(name), expected);
        }
    }

    #[test]
    fn folded_names_ignore_case_and_unicode_form() {
        assert_eq!(folded("Images\\STRASSE e\u{301}.JPG"), folded("images/strasse \u{e9}.jpg"));
        assert_ne!(folded("a/é"), folded("a/e"));
        assert_eq!(["a/r_0.5", "a/b.Jpeg", "b"].map(without_extension), ["a/r_0.5", "a/b", "b"]);
    }

    #[test]
    fn drives_and_network_folders_are_absolute() {
        assert!(["C:\\a.png", "d:/a", "\\\\server\\a", "\\a"].into_iter().all(is_windows_absolute));
        assert!(["a:b.png", "images/C:/a", "/a", "c", ""].into_iter().all(|name| !is_windows_absolute(name)));
    }
}
