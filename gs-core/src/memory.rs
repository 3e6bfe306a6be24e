//! Allocation of large arrays: a refusal is an error, where `vec!` and `collect` would abort the
//! process.

use crate::error::Error;

/// An empty list with room for `len` elements; `what` names them in the error.
///
/// # Errors
/// [`Error::Memory`] where the system refuses.
pub fn reserved<T>(len: usize, what: &'static str) -> Result<Vec<T>, Error> {
    let mut list = Vec::new();
    reserve(&mut list, len, what)?;
    Ok(list)
}

/// A list of `len` equal elements; `what` names them in the error.
///
/// # Errors
/// [`Error::Memory`] where the system refuses.
pub(crate) fn filled<T: Clone>(len: usize, value: T, what: &'static str) -> Result<Vec<T>, Error> {
    let mut list = reserved(len, what)?;
    list.resize(len, value);
    Ok(list)
}

/// Changes the length of a list; new elements are `value`, and `what` names them in the error.
///
/// # Errors
/// [`Error::Memory`] where the system refuses; the list is then as before.
pub fn resize<T: Clone>(list: &mut Vec<T>, len: usize, value: T, what: &'static str) -> Result<(), Error> {
    reserve(list, len, what)?;
    list.resize(len, value);
    Ok(())
}

/// Makes room for `len` elements of a list in all; `what` names them in the error.
///
/// # Errors
/// [`Error::Memory`] where the system refuses; the list is then as before.
pub fn reserve<T>(list: &mut Vec<T>, len: usize, what: &'static str) -> Result<(), Error> {
    let more = len.saturating_sub(list.len());
    let bytes = (len as u64).saturating_mul(size_of::<T>() as u64);
    list.try_reserve(more).map_err(|_| Error::Memory { what, bytes })
}

/// A number of bytes as text: "512 MB", "6.1 GB".
pub fn amount(bytes: u64) -> String {
    match bytes {
        0..10_000_000 => format!("{:.1} MB", bytes as f64 * 1e-6),
        10_000_000..1_000_000_000 => format!("{:.0} MB", bytes as f64 * 1e-6),
        _ => format!("{:.1} GB", bytes as f64 * 1e-9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refused_memory_is_an_error_with_its_amount_and_purpose() {
        let error = filled(1 << 59, 0u64, "a test").unwrap_err();
        assert_eq!(error, Error::Memory { what: "a test", bytes: 1 << 62 });
        let message = error.to_string();
        assert!(message.starts_with("a test: 4611686018.4 GB of memory were refused"), "{message}");
        let mut list = vec![1, 2];
        assert!(resize(&mut list, usize::MAX, 0, "a test").is_err());
        assert_eq!(list, [1, 2]);
        resize(&mut list, 3, 7, "a test").unwrap();
        assert_eq!(list, [1, 2, 7]);
    }

    #[test]
    fn amounts_have_a_suitable_unit() {
        assert_eq!([500_000, 20_400_000, 6_100_000_000].map(amount), ["0.5 MB", "20 MB", "6.1 GB"]);
    }
}
