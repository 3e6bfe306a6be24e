//! SH degrees and their numbers of coefficients.

/// The highest degree of scenes; files may have 4.
pub(crate) const MAX_DEGREE: u8 = 3;

/// The highest degree in files.
pub(crate) const MAX_FILE_DEGREE: u8 = 4;

/// Number of coefficients above degree 0 in all three channels: 0, 9, 24, 45, 72.
pub(crate) fn rest_of_degree(degree: u8) -> usize {
    3 * ((usize::from(degree) + 1).pow(2) - 1)
}

/// The degree, up to [`MAX_FILE_DEGREE`], with this number of coefficients above degree 0.
pub(crate) fn degree_of_rest(rest: usize) -> Option<u8> {
    (0..=MAX_FILE_DEGREE).find(|&degree| rest_of_degree(degree) == rest)
}
