//! The words over the picture and in the title: how long frames take, with which effects, on what.

use gs_core::effects::{Antialias, Order};

use crate::{
    values::Color,
    view::{navigation::Mode, pace::BUDGET_MS, session::Session},
};

/// What does not change while the window is open.
#[derive(Debug, Clone)]
pub(crate) struct Subject {
    /// The scene's name for people.
    pub(crate) name: String,
    /// How many Gaussians it has.
    pub(crate) gaussians: usize,
    /// Degree of its spherical harmonics.
    pub(crate) sh_degree: u8,
    /// The backend, and what it runs on.
    pub(crate) machine: String,
}

/// The lines over the picture, most important first.
pub(crate) fn lines(subject: &Subject, session: &Session) -> Vec<String> {
    let Subject { name, gaussians, sh_degree, machine } = subject;
    let effects = &session.settings.effects;
    let antialias_keys = match session.navigator.mode() {
        Mode::Orbit => "A",
        Mode::Fly => "3 4 5",
    };
    let mut lines = vec![
        format!("{name} · {gaussians} Gaussians · {machine}"),
        frame(session),
        format!(
            "order {} (O) · antialias {} ({antialias_keys}) · SH degree {} of {sh_degree} · background {}",
            order(effects.order),
            antialias(effects.antialias),
            effects.sh_degree.min(*sh_degree),
            background(session),
        ),
        match session.navigator.mode() {
            Mode::Orbit => "orbit: drag turns, right or shift+drag pans, wheel zooms, arrows turn".to_owned(),
            Mode::Fly => {
                let speed = session.navigator.speed();
                format!("fly: WASD QE move, shift faster, drag or arrows look, wheel sets the speed ({speed:.3}/s)")
            }
        },
        "F orbit/fly · R reset · H hides this · Esc closes".to_owned(),
    ];
    if let Some(shown) = session.shown().filter(|shown| shown.divisor > 1) {
        let divisor = shown.divisor;
        let whole = session.whole_ms.map_or(String::new(), |whole| format!(": a whole frame takes {whole:.0} ms"));
        let why =
            format!("1/{divisor} of the resolution while it moves{whole}, and more than {BUDGET_MS} is no motion");
        lines.push(format!("{why}; whole again at rest"));
    }
    lines.extend(session.notice.clone());
    lines
}

/// The window's title.
pub(crate) fn title(subject: &Subject, session: &Session) -> String {
    let effects = &session.settings.effects;
    let time = session.times.median().map_or(String::new(), |time| format!(" {time:.1} ms,"));
    format!(
        "gs view {}:{time} {}, {}, SH {}, background {}, {}",
        subject.name,
        order(effects.order),
        antialias(effects.antialias),
        effects.sh_degree.min(subject.sh_degree),
        background(session),
        subject.machine,
    )
}

fn frame(session: &Session) -> String {
    let (Some(median), Some(shown)) = (session.times.median(), session.shown()) else {
        return "drawing the first frame".to_owned();
    };
    let of = match session.times.len() {
        1 => "one frame".to_owned(),
        frames => format!("median of {frames} frames"),
    };
    let (width, height) = shown.size();
    format!("{median:.1} ms a frame ({of}) · {width}x{height} px")
}

fn order(order: Order) -> &'static str {
    match order {
        Order::Index => "index",
        Order::TileDepth => "tile-depth",
        Order::PixelDepth => "pixel-depth",
    }
}

fn antialias(antialias: Antialias) -> &'static str {
    match antialias {
        Antialias::None => "none",
        Antialias::Dilate => "dilate",
        Antialias::Mip => "mip",
    }
}

fn background(session: &Session) -> String {
    match session.settings.backdrop() {
        [0.0, 0.0, 0.0] => "black".to_owned(),
        [1.0, 1.0, 1.0] => "white".to_owned(),
        color => Color(color).to_string(),
    }
}
