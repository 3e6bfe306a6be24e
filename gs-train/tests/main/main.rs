//! Tests of training. One binary for all modules, so that the tests link once.

mod encode;
mod evidence;
mod exposure;
mod fit;
mod fixture_2d;
mod fixture_3d;
mod floaters;
mod frame;
mod masks;
mod panorama;
mod planted;
mod poses;
mod recovery;
mod reduction;
mod regularization;
mod resume;
mod train;
mod trial;
mod trouble;
mod unseen;
