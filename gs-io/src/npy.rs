//! NumPy arrays of two dimensions (`.npy`), as depth maps and poses are stored.
//!
//! *Source:* NumPy Enhancement Proposal 1, "A Simple File Format for NumPy Arrays".

/// The header of an array, which agrees with the size of its file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Npy {
    pub(crate) rows: u32,
    pub(crate) columns: u32,
    kind: Kind,
    /// Byte offset of the numbers in the file.
    start: usize,
}

/// The type of an array's numbers, little-endian.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    F32,
    F64,
    U16,
}

impl Npy {
    /// Reads the header in the first bytes of a file of `file_bytes`. It usually has 128.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub(crate) fn header(bytes: &[u8], file_bytes: u64) -> Result<Self, String> {
        let not = "it is not a NumPy array (.npy)";
        let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or(not)?;
        let (length, start) = match *rest {
            [1, _, a, b, ..] => (usize::from(u16::from_le_bytes([a, b])), 10),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([a, b, c, d]) as usize, 12),
            _ => return Err(not.to_owned()),
        };
        let text = bytes.get(start..).and_then(|rest| rest.get(..length)).ok_or("its header is cut off")?;
        let text = std::str::from_utf8(text).map_err(|_| not)?;
        let value = |key: &str| {
            let (_, rest) = text.split_once(&format!("'{key}':"))?;
            Some(rest.trim_start())
        };
        let (descr, order, shape) =
            value("descr").zip(value("fortran_order")).zip(value("shape")).map(|((a, b), c)| (a, b, c)).ok_or(not)?;
        let kinds = [("'<f4'", Kind::F32), ("'<f8'", Kind::F64), ("'<u2'", Kind::U16)];
        let kind = kinds.iter().find(|(name, _)| descr.starts_with(name)).map(|(_, kind)| *kind);
        let kind = kind.ok_or("its numbers must be of type float32, float64 or uint16, little-endian")?;
        if !order.starts_with("False") {
            return Err("it must be in C order".to_owned());
        }
        let shape = shape.strip_prefix('(').and_then(|rest| rest.split_once(')')).map(|(inside, _)| inside);
        let sides: Vec<u32> = shape.ok_or(not)?.split(',').filter_map(|side| side.trim().parse().ok()).collect();
        let &[rows, columns] = &sides[..] else {
            let shape = shape.unwrap_or_default().trim();
            return Err(format!("it must have two dimensions (rows, columns), not ({shape})"));
        };
        let expected = u128::from(rows) * u128::from(columns) * kind.bytes() as u128;
        let found = file_bytes.saturating_sub((start + length) as u64);
        if u128::from(found) != expected {
            return Err(format!(
                "it has {rows} rows and {columns} columns, but {found} bytes of numbers where {expected} are needed"
            ));
        }
        Ok(Self { rows, columns, kind, start: start + length })
    }

    /// The numbers in the bytes of the whole file, row-major; `None` if the file has another size than
    /// its header says.
    pub(crate) fn numbers<'b>(&self, bytes: &'b [u8]) -> Option<impl ExactSizeIterator<Item = f64> + 'b> {
        let numbers = bytes.get(self.start..)?.chunks_exact(self.kind.bytes());
        let is_whole = numbers.len() == self.rows as usize * self.columns as usize && numbers.remainder().is_empty();
        is_whole.then(|| numbers.map(number))
    }
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Self::F32 => 4,
            Self::F64 => 8,
            Self::U16 => 2,
        }
    }
}

/// The number in 4 bytes of `f32`, 8 of `f64` or 2 of `u16`.
fn number(bytes: &[u8]) -> f64 {
    match *bytes {
        [a, b, c, d] => f32::from_le_bytes([a, b, c, d]).into(),
        [a, b, c, d, e, f, g, h] => f64::from_le_bytes([a, b, c, d, e, f, g, h]),
        [a, b] => u16::from_le_bytes([a, b]).into(),
        _ => f64::NAN,
    }
}
