//! The meaning of keys. Commands depend on the character of a key, flight on its position, so that
//! W, A, S and D have the same layout on every keyboard.

use std::collections::HashSet;

use glam::{Vec2, Vec3};
use gs_core::effects::Effect;
use winit::keyboard::{Key, KeyCode, NamedKey};

use crate::navigation::{Mode, Motion};

/// The speed with the shift key, in times of the usual.
const SHIFT_SPEED: f32 = 4.0;

/// A command of a key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Command {
    /// Orbit or fly.
    SwitchMode,
    /// Back to the first camera.
    Reset,
    /// The next value of an effect.
    Next(Effect),
    /// A value of an effect, by its place in [`Effect::values`].
    Choose(Effect, usize),
    /// Zoom in, as by the wheel.
    ZoomIn,
    /// Zoom out.
    ZoomOut,
    /// Show or hide the overlay.
    Text,
    /// Close the window.
    Close,
}

/// The command of a key. When flying, A is a direction and not a command.
pub(crate) fn command(key: &Key, mode: Mode) -> Option<Command> {
    let text = match key {
        Key::Named(NamedKey::Escape) => return Some(Command::Close),
        Key::Character(text) => text.to_lowercase(),
        _ => return None,
    };
    Some(match (text.as_str(), mode) {
        ("r", _) => Command::Reset,
        ("h", _) => Command::Text,
        ("+" | "=", Mode::Pan) => Command::ZoomIn,
        ("-" | "_", Mode::Pan) => Command::ZoomOut,
        (_, Mode::Pan) => return None,
        ("f", _) => Command::SwitchMode,
        ("o", _) => Command::Next(Effect::Order),
        ("a", Mode::Orbit) => Command::Next(Effect::Antialias),
        (digit, _) => match digit.parse() {
            // The order by index is for 2D scenes only.
            Ok(order @ 1..=2) => Command::Choose(Effect::Order, order),
            Ok(digit @ 3..=6) => Command::Choose(Effect::Antialias, digit - 3),
            _ => return None,
        },
    })
}

/// The keys that are held down.
#[derive(Debug, Clone, Default)]
pub(crate) struct HeldKeys(pub(crate) HashSet<KeyCode>);

impl HeldKeys {
    /// Whether a shift key is held.
    pub(crate) fn shift(&self) -> bool {
        self.any(&[KeyCode::ShiftLeft, KeyCode::ShiftRight])
    }

    /// The motion that they stand for.
    pub(crate) fn motion(&self, mode: Mode) -> Motion {
        use KeyCode::{ArrowDown, ArrowLeft, ArrowRight, ArrowUp, KeyA, KeyD, KeyE, KeyQ, KeyS, KeyW};
        let axis = |more: KeyCode, less: KeyCode| f32::from(self.any(&[more])) - f32::from(self.any(&[less]));
        let way = match mode {
            Mode::Orbit | Mode::Pan => Vec3::ZERO,
            Mode::Fly => Vec3::new(axis(KeyD, KeyA), axis(KeyE, KeyQ), axis(KeyW, KeyS)),
        };
        let turn = Vec2::new(axis(ArrowRight, ArrowLeft), axis(ArrowDown, ArrowUp));
        Motion { way, turn, speed: if self.shift() { SHIFT_SPEED } else { 1.0 } }
    }

    fn any(&self, keys: &[KeyCode]) -> bool {
        keys.iter().any(|key| self.0.contains(key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn character(text: &str) -> Key {
        Key::Character(text.into())
    }

    #[test]
    fn letters_are_commands_in_either_case_but_a_flies() {
        for (key, expected) in [("f", Command::SwitchMode), ("R", Command::Reset), ("o", Command::Next(Effect::Order))]
        {
            assert_eq!(command(&character(key), Mode::Orbit), Some(expected));
            assert_eq!(command(&character(key), Mode::Fly), Some(expected));
        }
        assert_eq!(command(&character("a"), Mode::Orbit), Some(Command::Next(Effect::Antialias)));
        assert_eq!(command(&character("a"), Mode::Fly), None);
        assert_eq!(command(&character("2"), Mode::Fly), Some(Command::Choose(Effect::Order, 2)));
        assert_eq!(command(&character("6"), Mode::Fly), Some(Command::Choose(Effect::Antialias, 3)));
        assert_eq!(command(&character("7"), Mode::Fly), None);
        assert_eq!(command(&Key::Named(NamedKey::Escape), Mode::Fly), Some(Command::Close));
        assert_eq!(command(&character("w"), Mode::Orbit), None);
    }

    #[test]
    fn a_picture_is_zoomed_by_keys_and_has_no_order_to_switch() {
        for (key, expected) in [("+", Command::ZoomIn), ("=", Command::ZoomIn), ("-", Command::ZoomOut)] {
            assert_eq!(command(&character(key), Mode::Pan), Some(expected));
            assert_eq!(command(&character(key), Mode::Orbit), None);
        }
        for key in ["f", "o", "a", "1", "5"] {
            assert_eq!(command(&character(key), Mode::Pan), None, "{key}");
        }
        assert_eq!(command(&character("R"), Mode::Pan), Some(Command::Reset));
    }

    #[test]
    fn held_keys_add_up() {
        let mut held = HeldKeys::default();
        assert!(held.motion(Mode::Fly).is_none());
        held.0.extend([KeyCode::KeyW, KeyCode::KeyD, KeyCode::ArrowUp]);
        assert_eq!(held.motion(Mode::Fly), Motion { way: Vec3::new(1.0, 0.0, 1.0), turn: -Vec2::Y, speed: 1.0 });
        assert_eq!(held.motion(Mode::Orbit).way, Vec3::ZERO);
        held.0.insert(KeyCode::KeyA);
        held.0.insert(KeyCode::ShiftRight);
        let motion = held.motion(Mode::Fly);
        assert_eq!((motion.way, motion.speed), (Vec3::Z, SHIFT_SPEED), "left and right cancel");
        held.0.remove(&KeyCode::KeyD);
        assert_eq!(held.motion(Mode::Fly).way, Vec3::new(-1.0, 0.0, 1.0));
        held.0.clear();
        assert!(held.motion(Mode::Fly).is_none() && !held.shift());
    }
}
