//! The text over the picture and in the title: time per frame, effects, backend, keys.

use gs_core::counted;

use crate::{
    navigation::{Mode, Navigate},
    resolution::BUDGET_MS,
    session::Session,
};

/// The part of the text that does not change.
#[derive(Debug, Clone)]
pub(crate) struct Subject {
    /// The scene's name.
    pub(crate) name: String,
    /// Number of Gaussians.
    pub(crate) gaussians: usize,
    /// SH degree of the scene.
    pub(crate) sh_degree: u8,
    /// The backend and its machine.
    pub(crate) machine: String,
}

/// The lines over the picture, most important first.
pub(crate) fn lines<N: Navigate>(subject: &Subject, session: &Session<N>) -> Vec<String> {
    let Subject { name, gaussians, machine, .. } = subject;
    let keys = match session.navigator.mode() {
        Mode::Orbit | Mode::Fly => "F orbit/fly · R reset · H hides this · Esc closes",
        Mode::Pan => "R reset · H hides this · Esc closes",
    };
    let mut lines = vec![
        format!("{name} · {} · {machine}", drawn(*gaussians, session)),
        frame(session),
        effects(subject, session),
        session.navigator.hint(),
        keys.to_owned(),
    ];
    if let Some(shown) = session.shown().filter(|shown| shown.divisor > 1) {
        let divisor = shown.divisor;
        lines.push(format!("1/{divisor} of the resolution while it moves, full resolution at rest"));
        let why = |whole: f32| format!("(a full frame takes {whole:.0} ms; motion needs {BUDGET_MS} ms or less)");
        lines.extend(session.full_ms.map(why));
    }
    lines.extend(session.notice.clone());
    lines
}

/// How many Gaussians are drawn: of a scene with levels of detail, fewer than it has.
fn drawn<N: Navigate>(all: usize, session: &Session<N>) -> String {
    let whole = counted(all, "Gaussian");
    let more = if session.again.is_some() { ", finer ones are being read" } else { "" };
    match session.gaussians.filter(|&drawn| drawn < all) {
        Some(drawn) => format!("{drawn} of {whole}{more}"),
        None => whole + more,
    }
}

/// The effects, and the keys that change them.
fn effects<N: Navigate>(subject: &Subject, session: &Session<N>) -> String {
    let (effects, background) = (&session.settings.effects, background(session));
    let keys = match session.navigator.mode() {
        Mode::Orbit => "A",
        Mode::Fly => "3 4 5 6",
        Mode::Pan => {
            let (blend, antialias) = (effects.blend.name(), effects.antialias.name());
            return format!("blend {blend} · antialias {antialias} · background {background}");
        }
    };
    format!(
        "order {} (O) · antialias {} ({keys}) · SH degree {} of {} · background {background}",
        effects.order.name(),
        effects.antialias.name(),
        effects.sh_degree.min(subject.sh_degree),
        subject.sh_degree,
    )
}

/// The window's title.
pub(crate) fn title<N: Navigate>(subject: &Subject, session: &Session<N>) -> String {
    let effects = &session.settings.effects;
    let time = session.times.median().map_or(String::new(), |time| format!(" {time:.1} ms,"));
    let (name, machine, antialias) = (&subject.name, &subject.machine, effects.antialias.name());
    let shown = match session.navigator.mode() {
        Mode::Pan => format!("blend {}, {antialias}", effects.blend.name()),
        Mode::Orbit | Mode::Fly => {
            format!("{}, {antialias}, SH {}", effects.order.name(), effects.sh_degree.min(subject.sh_degree))
        }
    };
    format!("{name}:{time} {shown}, background {}, {machine}", background(session))
}

fn frame<N: Navigate>(session: &Session<N>) -> String {
    let (Some(median), Some(shown)) = (session.times.median(), session.shown()) else {
        return "rendering the first frame".to_owned();
    };
    let of = match session.times.len() {
        1 => "one frame".to_owned(),
        frames => format!("median of {}", counted(frames, "frame")),
    };
    let (width, height) = shown.size();
    format!("{median:.1} ms a frame ({of}) · {width}x{height} px")
}

fn background<N: Navigate>(session: &Session<N>) -> String {
    match session.settings.background_color() {
        [0.0, 0.0, 0.0] => "black".to_owned(),
        [1.0, 1.0, 1.0] => "white".to_owned(),
        [r, g, b] => format!("{r},{g},{b}"),
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use glam::{Vec2, Vec3};
    use gs_core::view::Bulk;
    use gs_core::{
        Blend, Image, RenderSettings,
        effects::{Antialias, Effect},
    };

    use super::*;
    use crate::{
        keys::Command,
        navigation::{CameraNavigator, CanvasNavigator, Drag},
        pixels::Picture,
        renderer::{Answer, Frame},
    };

    /// The lines and the title after `frames` frames that each took so long, the first at rest, the
    /// others moving.
    fn texts(frames: u32, milliseconds: u64, commands: &[Command]) -> (Vec<String>, String) {
        let bulk = Bulk { center: Vec3::ZERO, radius: 1.0 };
        let camera = bulk.overview(80, 60, 0.9, Vec3::NEG_Y).unwrap();
        let mut settings = RenderSettings::blended(Blend::Over).on([1.0; 3]);
        settings.effects.sh_degree = 3;
        settings.effects.antialias = Antialias::Dilate;
        let mut session = Session::new(CameraNavigator::new(&camera, 3.0, Vec3::NEG_Y, bulk), settings);
        session.resize(80, 60);
        commands.iter().for_each(|&command| session.obey(command));
        session.grab(Drag::Turn);
        let mut now = Instant::now();
        for frame in 0..frames {
            let request = session.next(now).request.unwrap();
            let image = Image::filled(request.size().0, request.size().1, [0.0; 3]).unwrap();
            let took = Duration::from_millis(milliseconds);
            session
                .take(Answer {
                    request,
                    result: Ok(Frame { picture: Picture::of(&image), took, gaussians: 7, is_coarse: false }),
                })
                .unwrap();
            now += Duration::from_millis(20);
            session.point(Vec2::splat(frame as f32 + 1.0), now);
        }
        let machine = "cpu (avx2, 2 threads)".to_owned();
        let subject = Subject { name: "a.ply".to_owned(), gaussians: 12, sh_degree: 2, machine };
        (lines(&subject, &session), title(&subject, &session))
    }

    #[track_caller]
    fn holds(text: &str, parts: &[&str]) {
        for part in parts {
            assert!(text.contains(part), "{part} is missing in {text}");
        }
    }

    #[test]
    fn time_effects_and_machine_are_shown() {
        holds(&texts(0, 0, &[]).0.join("\n"), &["rendering the first frame"]);
        let order = Command::Choose(Effect::Order, 2);
        let (lines, title) = texts(3, 12, &[order]);
        let effects = ["per-pixel", "dilate", "background white", "cpu (avx2, 2 threads)", "12.0 ms", "a.ply"];
        holds(&title, &effects);
        holds(&title, &["SH 2"]);
        holds(&lines.join("\n"), &effects);
        holds(
            &lines.join("\n"),
            &["median of 3 frames", "80x60 px", "SH degree 2 of 2", "12 Gaussians", "F orbit/fly"],
        );
        assert!(!lines.join("\n").contains("resolution"), "it is full: {lines:?}");
        let (lines, _) = texts(1, 12, &[Command::SwitchMode]);
        holds(&lines.join("\n"), &["one frame", "WASD", "antialias dilate (3 4 5 6)"]);
    }

    #[test]
    fn a_lower_resolution_is_explained() {
        let (lines, _) = texts(2, 180, &[]);
        holds(
            &lines.join("\n"),
            &["1/2 of the resolution while it moves", "a full frame takes 180 ms", "needs 50 ms or less", "at rest"],
        );
        holds(&lines.join("\n"), &["40x30 px"]);
    }

    #[test]
    fn a_2d_scene_has_no_order_and_no_sh() {
        let session = Session::new(CanvasNavigator::new(30, 20), RenderSettings::blended(Blend::Sum));
        let subject = Subject { name: "a".to_owned(), gaussians: 3, sh_degree: 0, machine: "cpu".to_owned() };
        let lines = lines(&subject, &session).join("\n");
        holds(&lines, &["blend sum", "100 %", "wheel or + - zoom", "R reset"]);
        assert!(!lines.contains("order") && !lines.contains("SH") && !lines.contains("fly"), "{lines}");
        holds(&title(&subject, &session), &["a: blend sum, none, background black, cpu"]);
    }
}
