//! Numbers, lists and conditions as the page shows them.

use crate::study::Matching;

pub(super) fn listed(values: &[u32]) -> String {
    values.iter().map(|&value| grouped(value)).collect::<Vec<_>>().join(", ")
}

/// A number with a comma before each three digits.
pub(super) fn grouped(value: u32) -> String {
    crate::report::figure::grouped(&value.to_string())
}

/// "1 Gaussian", "9,000 Gaussians".
pub(super) fn gaussians(count: u32) -> String {
    format!("{} Gaussian{}", grouped(count), if count == 1 { "" } else { "s" })
}

/// A number with its sign; the minus is as wide as the plus.
pub(super) fn signed(value: f64, digits: usize) -> String {
    format!("{value:+.digits$}").replace('-', "−")
}

/// What is held equal, in words.
pub(super) fn at_equal(matching: Matching) -> &'static str {
    match matching {
        Matching::Count => "at equal count",
        Matching::Iterations => "after equal iterations",
        Matching::Time => "after equal time",
    }
}

pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_by_thousands() {
        assert_eq!([0, 999, 1000, 9000, 1_234_567].map(grouped), ["0", "999", "1,000", "9,000", "1,234,567"]);
        assert_eq!(capital("at equal count"), "At equal count");
    }
}
