//! The photographs of a folder, with what their files say about the camera.

use std::{
    collections::BTreeSet,
    fs,
    fs::File,
    io::BufReader,
    path::{Path, PathBuf},
    time::UNIX_EPOCH,
};

use exif::{In, Tag, Value};
use gs_core::counted;
use gs_io::OutputFolder;

use crate::{
    error::Error,
    input::heic::{Converter, Heic},
    reporter::{Reporter, Stage},
    work::{FILES, WORK, remove},
};

/// Folders inside the named one that hold the photographs, if it has none itself.
const INNER: [&str; 2] = ["images", "input"];

/// Names of folders of other pictures.
const OTHERS: [&str; 6] = ["mask", "masks", "depth", "depths", "normals", "sparse"];

/// How deep folders of photographs may be nested.
const DEEPEST: usize = 3;

/// The photographs of a folder.
#[derive(Debug, Clone)]
pub struct Photographs {
    /// The folder that was named.
    pub folder: PathBuf,
    /// The photographs, sorted by name; at least two with those that are to be converted.
    pub files: Vec<Photograph>,
    /// Files that were left out, each with the reason.
    pub left_out: Vec<String>,
    /// HEIC photographs, to be converted.
    pub(crate) heic: Vec<Heic>,
}

/// A photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct Photograph {
    /// The path below the folder of photographs, with `/`.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// Its mask, a PNG that is black where pixels are to be ignored.
    pub mask: Option<PathBuf>,
    /// Columns and rows as stored, px.
    pub size: (u32, u32),
    /// What its EXIF data says.
    pub exif: Exif,
}

/// What the EXIF data of a photograph says about how it was taken.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Exif {
    /// Maker, model and lens, as far as they are there.
    pub camera: String,
    /// Focal length, hundredths of a millimetre.
    pub focal: Option<u32>,
    /// Focal length for 35 mm film, mm.
    pub focal_35mm: Option<u32>,
    /// How the stored pixels are turned to be shown: 1 to 8, and 1 without EXIF data.
    pub orientation: u8,
    /// Latitude and longitude, billionths of a degree, and altitude, mm.
    pub gps: Option<[i64; 3]>,
    /// When it was taken, by the clock of the camera: a text that sorts by time.
    pub taken: Option<String>,
}

impl Photographs {
    /// Finds the photographs of a folder: those in it and in its subfolders, or in its `images` or
    /// `input` if it has any there. Masks are in a folder `masks` inside or next to it, by the names
    /// of their photographs.
    ///
    /// # Errors
    /// [`Error::NotAFolder`], [`Error::TooFew`] for fewer than two, [`Error::Path`] where the folder
    /// cannot be read.
    pub fn find(folder: &Path) -> Result<Self, Error> {
        if !folder.is_dir() {
            return Err(Error::NotAFolder { path: folder.to_owned() });
        }
        fs::read_dir(folder).map_err(Error::at(folder))?;
        let has_images = |folder: &PathBuf| {
            gs_io::image_files(folder).is_ok_and(|files| !files.is_empty()) || !gs_io::heic_files(folder).is_empty()
        };
        let inner = INNER.iter().map(|name| folder.join(name)).find(has_images);
        let root = inner.filter(|_| !has_images(&folder.to_owned())).unwrap_or_else(|| folder.to_owned());
        Self::of(folder, &root)
    }

    /// The photographs below `root`, of what the user named `folder`.
    pub(crate) fn of(folder: &Path, root: &Path) -> Result<Self, Error> {
        let mut found = Self { folder: folder.to_owned(), files: Vec::new(), left_out: Vec::new(), heic: Vec::new() };
        let masks = [root.join("masks"), folder.join("masks"), root.join("../masks")];
        let masks = masks.into_iter().find(|folder| folder.is_dir());
        found.add(root, root, 0, masks.as_deref())?;
        found.files.sort_by(|a, b| a.name.cmp(&b.name));
        let Self { files, heic, .. } = &mut found;
        // Many were exported next to the originals.
        let mut keys: BTreeSet<String> = files.iter().map(|photograph| key(&photograph.name)).collect();
        heic.retain(|heic| keys.insert(key(&heic.name)));
        if found.count() < 2 {
            return Err(found.too_few(root));
        }
        Ok(found)
    }

    fn too_few(&self, root: &Path) -> Error {
        let count = match self.count() {
            0 => "no photograph".to_owned(),
            count => counted(count, "photograph"),
        };
        // HEIC photographs can be converted.
        let unreadable = || gs_io::unreadable_photographs(root).filter(|_| gs_io::heic_files(root).is_empty());
        let why = self.left_out.first().cloned().or_else(unreadable);
        let found = why.map_or(count.clone(), |why| format!("{count} ({why})"));
        Error::TooFew { folder: self.folder.clone(), found }
    }

    /// Converts the HEIC photographs, and puts them into `images` of the folder, unless an earlier run did and `resume`
    /// is set. The time of a JPEG tells of which file it was made.
    pub(crate) fn converted(
        mut self,
        (folder, resume): (&OutputFolder, bool),
        reporter: &mut dyn Reporter,
    ) -> Result<Self, Error> {
        let heic = std::mem::take(&mut self.heic);
        let Some(first) = heic.first() else { return Ok(self) };
        let converter = Converter::find(&first.path)?;
        let work = folder.path().join(WORK).join("heic");
        for (done, Heic { name, path, mask }) in heic.iter().enumerate() {
            reporter.progress(Stage::Converting, done, heic.len());
            if reporter.is_cancelled() {
                return Err(Error::Cancelled { stage: Stage::Converting.words() });
            }
            let name_there = format!("images/{name}");
            let target = folder.path().join(&name_there);
            let time = |path: &Path| fs::metadata(path).and_then(|metadata| metadata.modified()).ok();
            let is_same = time(path).is_some_and(|made_of| time(&target) == Some(made_of));
            if !(resume && is_same && folder.claimed(&name_there).contains(&name_there)) {
                remove(&work)?;
                fs::create_dir_all(&work).map_err(Error::at(&work))?;
                match converter.convert(path, &work) {
                    Ok(file) => {
                        folder.claim([&*name_there])?;
                        fs::create_dir_all(target.parent().unwrap_or(&work)).map_err(Error::at(&target))?;
                        if let (Some(time), Ok(file)) = (time(path), File::options().write(true).open(&file)) {
                            // Without it, the next run converts the photograph again.
                            let _ = file.set_modified(time);
                        }
                        fs::rename(file, folder.file(&name_there)).map_err(Error::at(&target))?;
                    }
                    Err(why) => {
                        self.left_out.push(why);
                        continue;
                    }
                }
            }
            self.add_file(name.clone(), target, mask.clone());
        }
        remove(&work)?;
        self.files.sort_by(|a, b| a.name.cmp(&b.name));
        if self.files.len() < 2 { Err(self.too_few(&self.folder)) } else { Ok(self) }
    }

    fn add_file(&mut self, name: String, path: PathBuf, mask: Option<PathBuf>) {
        match gs_io::read_image_size(&path) {
            Ok(size) => {
                let exif = Exif::read(&path);
                self.files.push(Photograph { name, path, mask, size, exif });
            }
            Err(error) => self.left_out.push(error.to_string()),
        }
    }

    fn add(&mut self, root: &Path, folder: &Path, depth: usize, masks: Option<&Path>) -> Result<(), Error> {
        for path in gs_io::image_files(folder)? {
            let Some(name) = name_below(root, &path) else {
                self.left_out.push(format!("{}: its name is not one that COLMAP reads", path.display()));
                continue;
            };
            let mask = masks.and_then(|masks| mask_of(masks, &name));
            self.add_file(name, path, mask);
        }
        for path in gs_io::heic_files(folder) {
            if let Some(name) = name_below(root, &path.with_extension("jpg")) {
                let mask = masks.and_then(|masks| mask_of(masks, &name_below(root, &path)?).or(mask_of(masks, &name)));
                self.heic.push(Heic { name, path, mask });
            }
        }
        if depth == DEEPEST {
            return Ok(());
        }
        let entries = fs::read_dir(folder).map_err(Error::at(folder))?.flatten().map(|entry| entry.path());
        let is_other = |path: &Path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
            name.starts_with('.') || OTHERS.contains(&name.as_str())
        };
        let mut folders: Vec<PathBuf> = entries.filter(|path| path.is_dir() && !is_other(path)).collect();
        // What an earlier run made of these photographs.
        folders.retain(|folder| !folder.join(FILES[0]).is_file() && !folder.join(".gs-files.json").is_file());
        folders.sort();
        folders.iter().try_for_each(|folder| self.add(root, folder, depth + 1, masks))
    }

    /// How many there are, with those that are to be converted.
    pub fn count(&self) -> usize {
        self.files.len() + self.heic.len()
    }

    /// The paths of all photographs and masks.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.files
            .iter()
            .flat_map(|photograph| [Some(&photograph.path), photograph.mask.as_ref()])
            .chain(self.heic.iter().flat_map(|heic| [Some(&heic.path), heic.mask.as_ref()]))
            .flatten()
            .map(|path| &**path)
    }
}

/// Name, size (bytes) and time (ms) of a file.
pub(crate) type Identity = (String, u64, u64);

/// The identity of a file, by a name for it.
pub(crate) fn identity(name: &str, path: &Path) -> Identity {
    let metadata = fs::metadata(path).ok();
    let time = metadata.as_ref().and_then(|metadata| metadata.modified().ok()?.duration_since(UNIX_EPOCH).ok());
    (name.to_owned(), metadata.map_or(0, |metadata| metadata.len()), time.map_or(0, |time| time.as_millis() as u64))
}

/// A name without its ending and in lower case: files of the same are versions of one photograph.
fn key(name: &str) -> String {
    Path::new(name).with_extension("").to_string_lossy().to_lowercase()
}

/// The path below a folder, with `/`; `None` for one that a list of COLMAP, a name per line without blanks
/// around it, cannot hold.
fn name_below(root: &Path, path: &Path) -> Option<String> {
    let parts: Option<Vec<&str>> =
        path.strip_prefix(root).ok()?.components().map(|part| part.as_os_str().to_str()).collect();
    let name = parts?.join("/");
    (name.trim() == name && !name.starts_with('#') && !name.contains(char::is_control)).then_some(name)
}

/// The mask of the photograph of this name: `NAME.png`, also without the name's own extension.
fn mask_of(masks: &Path, name: &str) -> Option<PathBuf> {
    let named = masks.join(name);
    [masks.join(format!("{name}.png")), named.with_extension("png")].into_iter().find(|path| path.is_file())
}

impl Exif {
    /// Reads the EXIF data of a file; without any, or with damaged data, nothing is known.
    fn read(path: &Path) -> Self {
        let upright = Self { orientation: 1, ..Self::default() };
        let Ok(file) = File::open(path) else { return upright };
        let Ok(data) = exif::Reader::new().read_from_container(&mut BufReader::new(file)) else { return upright };
        let field = |tag| data.get_field(tag, In::PRIMARY);
        let text = |tag| match &field(tag)?.value {
            Value::Ascii(lines) => lines.first().map(|line| String::from_utf8_lossy(line).trim().to_owned()),
            _ => None,
        };
        let number = |tag| field(tag)?.value.get_uint(0);
        let focal = match field(Tag::FocalLength).map(|field| &field.value) {
            Some(Value::Rational(values)) => values.first().map(|value| value.to_f64()),
            _ => None,
        };
        let parts =
            [Tag::Make, Tag::Model, Tag::LensModel].into_iter().filter_map(text).filter(|part| !part.is_empty());
        // A camera whose clock was not set writes blanks or zeros.
        let time = text(Tag::DateTimeOriginal).filter(|time| time.starts_with(['1', '2']));
        let fraction = || text(Tag::SubSecTimeOriginal).unwrap_or_default();
        Self {
            camera: parts.collect::<Vec<_>>().join(" "),
            focal: focal.filter(|focal| *focal > 0.0 && *focal < 1e5).map(|focal| (focal * 100.0).round() as u32),
            focal_35mm: number(Tag::FocalLengthIn35mmFilm).filter(|focal| *focal > 0),
            orientation: number(Tag::Orientation)
                .and_then(|n| u8::try_from(n).ok())
                .filter(|n| (1..=8).contains(n))
                .unwrap_or(1),
            gps: position(&data),
            taken: time.map(|time| format!("{time}.{}", fraction())),
        }
    }
}

/// The GPS position in EXIF data: latitude and longitude, billionths of a degree, and altitude, mm. All zero stands for
/// none.
fn position(data: &exif::Exif) -> Option<[i64; 3]> {
    let value = |tag| data.get_field(tag, In::PRIMARY).map(|field| &field.value);
    let number = |tag, unit: f64, most: f64| {
        let Value::Rational(parts) = value(tag)? else { return None };
        let sum: f64 = parts.iter().zip([1.0, 60.0, 3600.0]).map(|(part, of)| part.to_f64() / of).sum();
        (sum <= most).then_some((sum * unit).round() as i64)
    };
    let is = |tag, letter: u8| match value(tag) {
        Some(Value::Ascii(texts)) => texts.first().and_then(|text| text.first()) == Some(&letter),
        Some(Value::Byte(bytes)) => bytes.first() == Some(&letter),
        _ => false,
    };
    let signed = |value: i64, is_negative: bool| if is_negative { -value } else { value };
    let latitude = signed(number(Tag::GPSLatitude, 1e9, 90.0)?, is(Tag::GPSLatitudeRef, b'S'));
    let longitude = signed(number(Tag::GPSLongitude, 1e9, 180.0)?, is(Tag::GPSLongitudeRef, b'W'));
    let altitude = signed(number(Tag::GPSAltitude, 1e3, 1e5)?, is(Tag::GPSAltitudeRef, 1));
    (latitude != 0 || longitude != 0).then_some([latitude, longitude, altitude])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is read of a file with these fields.
    fn exif_of(fields: impl IntoIterator<Item = (Tag, Value)>) -> Exif {
        let fields = fields.into_iter().map(|(tag, value)| exif::Field { tag, ifd_num: In::PRIMARY, value });
        let fields: Vec<_> = fields.collect();
        let mut writer = exif::experimental::Writer::new();
        fields.iter().for_each(|field| writer.push_field(field));
        let file = tempfile::NamedTempFile::new().unwrap();
        writer.write(&mut File::create(file.path()).unwrap(), false).unwrap();
        Exif::read(file.path())
    }

    #[test]
    fn times_sort_as_texts() {
        let taken = |time: &str, fraction: &str| {
            let ascii = |text: &str| Value::Ascii(vec![text.into()]);
            exif_of([(Tag::DateTimeOriginal, ascii(time)), (Tag::SubSecTimeOriginal, ascii(fraction))]).taken
        };
        let times = [("2025:12:31 23:59:59", "9"), ("2026:01:02 03:04:05", "09"), ("2026:01:02 03:04:05", "1")];
        let times = times.map(|(time, fraction)| taken(time, fraction).unwrap());
        assert!(times.is_sorted() && times[1] == "2026:01:02 03:04:05.09", "{times:?}");
        for unknown in ["    :  :     :  :  ", "0000:00:00 00:00:00", ""] {
            assert_eq!(taken(unknown, "1"), None, "{unknown}");
        }
        assert_eq!(exif_of([(Tag::Orientation, Value::Short(vec![1]))]).taken, None);
    }

    #[test]
    fn positions_are_read_with_their_signs() {
        let rational = |parts: &[(u32, u32)]| {
            Value::Rational(parts.iter().map(|(num, denom)| exif::Rational { num: *num, denom: *denom }).collect())
        };
        let read = |latitude: &[(u32, u32)], side: &[u8], altitude: &[(u32, u32)]| {
            let fields = [
                (Tag::GPSLatitude, rational(latitude)),
                (Tag::GPSLatitudeRef, Value::Ascii(vec![side.to_vec()])),
                (Tag::GPSLongitude, rational(&[(7, 1), (12, 1), (36, 1)])),
                (Tag::GPSLongitudeRef, Value::Ascii(vec![b"W".to_vec()])),
                (Tag::GPSAltitude, rational(altitude)),
                (Tag::GPSAltitudeRef, Value::Byte(vec![1])),
            ];
            exif_of(fields).gps
        };
        let place = [(57, 1), (30, 1), (3600, 100)];
        assert_eq!(read(&place, b"S", &[(125, 10)]), Some([-57_510_000_000, -7_210_000_000, -12_500]));
        assert_eq!(read(&place, b"N", &[(125, 10)]).unwrap()[0], 57_510_000_000);
        assert_eq!(read(&[(91, 1)], b"N", &[(1, 1)]), None);
        assert_eq!(read(&[(1, 0)], b"N", &[(1, 1)]), None);
        assert_eq!(read(&place, b"N", &[(0, 0)]), None);
    }

    #[test]
    fn only_a_folder_holds_photographs() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for path in [file.path(), Path::new("no/such/folder")] {
            let error = Photographs::find(path).unwrap_err();
            assert!(matches!(&error, Error::NotAFolder { path: found } if found == path), "{error}");
        }
    }
}
