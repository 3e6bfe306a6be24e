//! The program as its users meet it: run as a process, judged by its exit status, what it prints
//! and what it leaves behind.

mod backends;
mod bad_input;
mod blocks;
mod compressed;
mod convert;
mod datasets;
mod doctor;
mod edit;
mod fit;
mod made_photographs;
mod memory;
mod output_folder;
mod page;
mod paper;
mod ply;
mod poses;
mod poses_found;
mod poses_neighbours;
mod poses_pycolmap;
mod poses_refined;
mod poses_video;
mod price;
mod process;
mod quality;
mod render;
mod scene2d;
mod scenes;
mod several;
mod shared_study;
mod study;
mod train;
mod training_folder;
mod view;
