//! Where the time of a training step goes, stage by stage, as backends report it.

/// One stage's time.
#[derive(Debug, Clone, PartialEq)]
pub struct StageTime {
    /// The stage's word: `project`, `bin`, `sort`, `blend`, `loss`, `blend_bwd`, `project_bwd`, `adam`; `fused` where a backend does
    /// several of them in one pass over the tiles.
    pub stage: &'static str,
    /// Seconds, one per repetition, in order.
    pub seconds: Vec<f64>,
}

/// What a profile measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// The stages in their order.
    pub stages: Vec<StageTime>,
    /// Pixel–Gaussian pairs that a blend kernel visits, those that a vector covers beyond an ellipse included.
    pub pairs: u64,
    /// Entries of all tiles' lists.
    pub entries: usize,
}
