//! Whether values of different size agree about their sign.

/// Whether the values are above `least` rather than below: by the sum of ranks of their differences from it, against
/// the sum expected by chance, so that a single value far off does not outweigh many. Never by one value alone.
///
/// *Source:* Wilcoxon 1945, *Individual Comparisons by Ranking Methods*.
pub(in crate::train) fn are_above(values: &[f64], least: f64) -> bool {
    let mut differences: Vec<f64> = values.iter().map(|value| value - least).collect();
    differences.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    let above = (1..).zip(&differences).filter(|(_, by)| **by > 0.0).map(|(rank, _)| f64::from(rank)).sum::<f64>();
    let count = differences.len() as f64;
    differences.len() > 1 && above > count * (count + 1.0) / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_small_values_outweigh_one_far_off() {
        let shows = |values: &[f64]| are_above(values, 0.1);
        assert!(shows(&[0.4, 0.6, -9.0, 0.3, 0.5, 0.7, 0.2, 0.4]));
        assert!(!shows(&[0.3, -0.5, -0.1, 0.2, -0.4, 9.0]));
        assert!(shows(&[0.2, 0.3]) && !shows(&[0.2, -0.2]));
        assert!(!shows(&[5.0]) && !shows(&[]) && !shows(&[0.0; 20]) && !shows(&[0.05; 20]), "no evidence");
    }
}
