//! The oracle, the conformance suite and the corpus tested themselves, and put to gs-cpu and
//! gs-wgpu; and training with these.

mod accuracy;
mod corpus;
mod cpu;
mod cpu_3d;
mod fuzzed;
mod gpus;
mod guards;
mod layout;
mod oracle;
mod oracle_3d;
mod public_scenes;
mod splitting;
mod suite;
mod suite_3d;
mod tolerance;
mod training;
mod wgpu;
mod wgpu_3d;
