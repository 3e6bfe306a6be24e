//! Reports of the work to a program.

/// A stage of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stage {
    /// Looking at the frames of a video.
    Video,
    /// Writing the frames of a video that become photographs.
    Frames,
    /// Converting HEIC photographs.
    Converting,
    /// Finding features in each photograph.
    Features,
    /// Comparing pairs of photographs.
    Matching,
    /// Finding poses and points from the matches.
    Mapping,
    /// Joining pieces of the scene that share photographs.
    Joining,
}

impl Stage {
    /// What is being done, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Video => "looking for sharp frames",
            Self::Frames => "writing the frames",
            Self::Converting => "converting HEIC photographs",
            Self::Features => "finding features",
            Self::Matching => "matching the photographs",
            Self::Mapping => "finding the poses",
            Self::Joining => "joining pieces",
        }
    }
}

/// Receives reports of the work, and can end it.
pub trait Reporter {
    /// How far a stage is: `done` of `total` frames, photographs or blocks of pairs.
    fn progress(&mut self, stage: Stage, done: usize, total: usize);

    /// Something worth a line.
    fn note(&mut self, line: &str);

    /// Whether the work is to end. It is called about ten times a second.
    fn is_cancelled(&self) -> bool;
}
