//! The example with a window, on a display of its own where Xvfb is installed.
#![cfg(target_os = "linux")]

use std::{
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
};

use gs_core::{Gaussian3d, Scene3d, constants::SH_C0};

/// A display, which ends with its test.
struct Display(Child, String);

impl Display {
    /// `None` where there is no Xvfb.
    fn new() -> Option<Self> {
        let mut xvfb = Command::new("Xvfb");
        xvfb.args(["-displayfd", "1", "-screen", "0", "320x240x24"]).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = xvfb.spawn().ok()?;
        let mut number = String::new();
        BufReader::new(child.stdout.take()?).read_line(&mut number).unwrap();
        Some(Self(child, format!(":{}", number.trim())))
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _status = self.0.wait();
    }
}

/// The example, asked for three pictures. `cargo test` builds it, and so does `cargo xtask test`.
fn window(scene: &Path, display: Option<&Display>) -> Command {
    let tests = std::env::current_exe().unwrap();
    let mut window = Command::new(tests.parent().unwrap().with_file_name("examples").join("window"));
    window.arg(scene).arg("3").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET").env_remove("DISPLAY");
    window.envs(display.map(|Display(_, name)| ("DISPLAY", name)));
    window
}

#[test]
fn a_window_drawn_by_wgpu_shows_a_scene() {
    let place = tempfile::tempdir().unwrap();
    let gaussian = |i: u8| Gaussian3d {
        mean: [f32::from(i), 0.0, 0.0].into(),
        log_scale: [-1.0; 3].into(),
        rotation: [1.0, 0.0, 0.0, 0.0],
        opacity_logit: 2.0,
        sh: vec![[0.4 / SH_C0; 3].into()],
    };
    let scene: Scene3d = (0..4).map(gaussian).collect();
    let path = place.path().join("scene.ply");
    gs_io::write_3d(&path, &scene, &Default::default()).unwrap();
    let refused = window(&path, None).output().unwrap();
    assert_eq!(refused.status.code(), Some(1), "without a display: {refused:?}");
    let Some(display) = Display::new() else { return eprintln!("skipped: there is no Xvfb") };
    let shown = window(&path, Some(&display)).output().unwrap();
    assert!(shown.status.success(), "{shown:?}");
    let absent = window(&place.path().join("absent.ply"), Some(&display)).output().unwrap();
    assert_eq!(absent.status.code(), Some(1), "{absent:?}");
}
