//! The program as its users meet it: run as a process, judged by its exit status, what it prints
//! and what it leaves behind.

mod backends;
mod bad_input;
mod compressed;
mod convert;
mod datasets;
mod doctor;
mod effects;
mod fit;
mod frontier;
mod memory;
mod output_folder;
mod page;
mod paper;
mod ply;
mod popping;
mod process;
mod profile;
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
