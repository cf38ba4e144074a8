//! Strength and frequency of the augmentations of a pair.

use serde::{Deserialize, Serialize};

/// Strengths and probabilities of all changes; those that older checkpoints do not name are 0.
///
/// The presets are [`none`](Self::none), [`light`](Self::light), [`strong`](Self::strong) and
/// [`shape`](Self::shape).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Augment {
    /// Reach of the logarithm of the search crop's scale.
    pub scale: f32,
    /// Reach of the target's place in the search crop, as a share of half its side.
    pub shift: f32,
    /// Probability of exchanging left and right.
    pub mirror: f32,
    /// Probability of a quarter turn or more: pictures from above have no upside.
    pub quarter: f32,
    /// Reach of the angle between the crops in degrees; three times that for stills.
    pub rotation: f32,
    /// Reach of the logarithm of the stretch between the crops; three times that for stills.
    pub aspect: f32,
    /// Probability that light and color of both crops differ from the picture.
    pub shared_color: f32,
    /// Probability that the search crop differs from the template in light and color; twice that
    /// for stills.
    pub own_color: f32,
    /// Probability that light falls on the search picture from one side.
    #[serde(default)]
    pub side_light: f32,
    /// Probability of gray crops.
    pub gray: f32,
    /// Probability of crops with more or less color.
    pub saturation: f32,
    /// Probability of negative colors, for stills.
    pub invert: f32,
    /// Probability per crop of a Gaussian blur.
    pub blur: f32,
    /// Probability per crop of motion blur.
    pub motion_blur: f32,
    /// Probability per crop of sensor noise.
    pub noise: f32,
    /// Probability per crop of JPEG artifacts.
    pub jpeg: f32,
    /// Probability of a lower resolution of all crops together.
    pub low_resolution: f32,
    /// Probability of pasted look-alikes in the search picture.
    pub distractors: f32,
    /// Share of the look-alikes that are of the target's own kind, where its data tell kinds apart.
    #[serde(default)]
    pub kin: f32,
    /// Probability that what lies outside the search picture is filled from another one, of the
    /// target's kind if that is known.
    #[serde(default)]
    pub beside: f32,
    /// Probability that a synthetic target is a ball that turns between the pictures.
    #[serde(default)]
    pub round: f32,
    /// Probability of something pasted over a part of the target.
    pub occluder: f32,
    /// Probability that the search crop is stretched by up to `stretch` and sheared by up to
    /// `shear`.
    #[serde(default)]
    pub stretched: f32,
    /// Reach of the logarithm of that stretch: widths times it, heights divided by it.
    #[serde(default)]
    pub stretch: f32,
    /// Reach of that shear, in pixels to the side per pixel down.
    #[serde(default)]
    pub shear: f32,
    /// Probability that the search crop takes back the change of the target's aspect since the
    /// template, as the tracker does; the random stretch comes on top.
    #[serde(default)]
    pub unstretched: f32,
    /// Largest share of a side that angle and shear may add to the other side of a box; 0 for no
    /// bound.
    #[serde(default)]
    pub slant: f32,
    /// Probability that a synthetic target changes its outline and stretch between the pictures.
    #[serde(default)]
    pub bend: f32,
    /// Share of pasted look-alikes that cover a part of the target.
    #[serde(default)]
    pub overlap: f32,
    /// Share of pasted look-alikes that stand directly beside the target.
    #[serde(default)]
    pub adjacent: f32,
    /// Share of pasted look-alikes that are the target itself in plainly other colors.
    #[serde(default)]
    pub twin: f32,
    /// Probability that a patch of background hides a part of the target.
    #[serde(default)]
    pub mask: f32,
    /// Probability that a shadow begins at the target's edge.
    #[serde(default)]
    pub shadow: f32,
}

impl Augment {
    /// Only scale and place vary, as in SiamFC++.
    pub const fn none() -> Augment {
        Augment {
            scale: 0.262, // ln 1.3
            shift: 0.4,
            mirror: 0.0,
            quarter: 0.0,
            rotation: 0.0,
            aspect: 0.0,
            shared_color: 0.0,
            own_color: 0.0,
            side_light: 0.0,
            gray: 0.0,
            saturation: 0.0,
            invert: 0.0,
            blur: 0.0,
            motion_blur: 0.0,
            noise: 0.0,
            jpeg: 0.0,
            low_resolution: 0.0,
            distractors: 0.0,
            kin: 0.0,
            beside: 0.0,
            round: 0.0,
            occluder: 0.0,
            stretched: 0.0,
            stretch: 0.0,
            shear: 0.0,
            unstretched: 0.0,
            slant: 0.0,
            bend: 0.0,
            overlap: 0.0,
            adjacent: 0.0,
            twin: 0.0,
            mask: 0.0,
            shadow: 0.0,
        }
    }

    /// Mild changes, for much and varied data.
    pub const fn light() -> Augment {
        Augment {
            mirror: 0.5,
            rotation: 2.0,
            aspect: 0.02,
            shared_color: 0.4,
            own_color: 0.2,
            side_light: 0.05,
            gray: 0.1,
            saturation: 0.15,
            blur: 0.06,
            motion_blur: 0.06,
            noise: 0.06,
            jpeg: 0.06,
            low_resolution: 0.15,
            distractors: 0.1,
            kin: 0.5,
            beside: 0.3,
            round: 0.5,
            occluder: 0.03,
            ..Augment::none()
        }
    }

    /// Every photometric change, for little data.
    pub const fn strong() -> Augment {
        Augment {
            mirror: 0.5,
            quarter: 0.15,
            rotation: 4.0,
            aspect: 0.035,
            shared_color: 0.7,
            own_color: 0.35,
            side_light: 0.15,
            gray: 0.15,
            saturation: 0.3,
            invert: 0.03,
            blur: 0.15,
            motion_blur: 0.14,
            noise: 0.12,
            jpeg: 0.12,
            low_resolution: 0.3,
            distractors: 0.35,
            kin: 0.5,
            beside: 0.6,
            round: 0.5,
            occluder: 0.1,
            ..Augment::none()
        }
    }

    /// Targets that change shape, and neighbors that touch or cover them; colors change less than
    /// in `strong`.
    pub const fn shape() -> Augment {
        Augment {
            rotation: 5.0,
            shared_color: 0.4,
            own_color: 0.25,
            side_light: 0.12,
            gray: 0.18,
            saturation: 0.2,
            invert: 0.02,
            low_resolution: 0.15,
            distractors: 0.4,
            beside: 0.5,
            occluder: 0.06,
            stretched: 0.4,
            stretch: 0.3,
            shear: 0.12,
            unstretched: 0.8,
            slant: 0.2,
            bend: 0.5,
            overlap: 0.3,
            adjacent: 0.25,
            twin: 0.2,
            mask: 0.1,
            shadow: 0.08,
            ..Augment::strong()
        }
    }

    /// The preset of a name: `none`, `light`, `strong` or `shape`.
    pub fn from_name(name: &str) -> Option<Augment> {
        match name {
            "none" => Some(Augment::none()),
            "light" => Some(Augment::light()),
            "strong" => Some(Augment::strong()),
            "shape" => Some(Augment::shape()),
            _ => None,
        }
    }
}
