//! ICC profiles of colours that stay as they are stored.

use std::{fmt, sync::Arc};

use base64::{Engine, engine::general_purpose::STANDARD};
use gs_core::Image;
use moxcms::ColorProfile;
use serde::{Deserialize, Serialize};

use super::color::{Colors, title};

/// The longest profile, bytes.
const MOST_BYTES: usize = u16::MAX as usize;

/// The ICC profile of colours that are not sRGB. JSON has it in base64.
///
/// It may be damaged: then it converts nothing, as when an image with it is read.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct IccProfile(Arc<[u8]>);

impl IccProfile {
    /// The profile of these bytes; `None` where there are none, or more than 65,535.
    pub fn new(bytes: &[u8]) -> Option<Self> {
        (1..=MOST_BYTES).contains(&bytes.len()).then(|| Self(bytes.into()))
    }

    /// The profile as a file embeds it.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// The name in the profile, such as "Display P3".
    pub fn name(&self) -> String {
        match ColorProfile::new_from_slice(&self.0) {
            Ok(profile) => title(&profile).unwrap_or_else(|| "without a name".to_owned()),
            Err(_) => "damaged".to_owned(),
        }
    }

    /// Converts an image to sRGB. Values are clamped to 0..=1 before and after.
    pub fn to_srgb(&self, image: &mut Image) {
        let pixels = image.pixels_mut();
        pixels.as_flattened_mut().iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        Colors::of_profile(&self.0).apply(pixels);
    }
}

impl fmt::Debug for IccProfile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "IccProfile({}, {} bytes)", self.name(), self.0.len())
    }
}

impl From<IccProfile> for String {
    fn from(profile: IccProfile) -> Self {
        STANDARD.encode(profile.bytes())
    }
}

impl TryFrom<String> for IccProfile {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let bytes = STANDARD.decode(text).map_err(|error| format!("the profile is not base64: {error}"))?;
        Self::new(&bytes).ok_or_else(|| format!("the profile has {} bytes, not 1 to {MOST_BYTES}", bytes.len()))
    }
}
