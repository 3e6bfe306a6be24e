//! The files that commands read, and the folders that they write.

pub(crate) mod lod;
pub(crate) mod output_folder;
pub(crate) mod page_files;
pub(crate) mod scene;
pub(crate) mod text_file;
