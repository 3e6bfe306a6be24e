//! Images, scene files and checkpoints, read and written.
