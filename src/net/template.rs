//! The cached template: the first frame's features and a moving average of later looks.
//!
//! The response is linear in the template, so one averaged template searches for all looks at
//! once. The first frame's part never fades: it is the only look known to show the target.

use super::map::Map;
use super::neck::TaskMaps;

/// The template's features, correlated with every search region.
#[derive(Clone, Debug, Default)]
pub struct TemplateFeatures {
    /// Neck features for classification: 4x4 for the standard template.
    pub cls: Map,
    /// Neck features for regression, of the same size.
    pub reg: Map,
    /// Identity-related features of the first frame: the output of E2, or of conv5 without E2;
    /// 6x6 for the standard template.
    pub identity: Map,
}

/// Share of one frame in the later looks, which therefore fade over about ten frames.
const RATE: f32 = 0.1;

/// The template and its first frame's part.
#[derive(Clone, Debug, Default)]
pub(crate) struct Template {
    features: TemplateFeatures,
    first_cls: Map,
    first_reg: Map,
}

impl Template {
    /// The features that search regions are correlated with.
    pub(crate) fn features(&self) -> &TemplateFeatures {
        &self.features
    }

    /// Starts again from the first frame's identity-related features and neck features.
    pub(crate) fn set(&mut self, identity: &Map, neck: &TaskMaps) {
        self.features = TemplateFeatures {
            cls: neck.cls.clone(),
            reg: neck.reg.clone(),
            identity: identity.clone(),
        };
        self.first_cls = neck.cls.clone();
        self.first_reg = neck.reg.clone();
    }

    /// Moves toward `(1 - share) * first + share * new`.
    pub(crate) fn add(&mut self, new: &TaskMaps, share: f32) {
        approach(&mut self.features.cls, &self.first_cls, &new.cls, share);
        approach(&mut self.features.reg, &self.first_reg, &new.reg, share);
    }
}

/// Moves `map` by [`RATE`] toward the mix of `first` and `new`.
fn approach(map: &mut Map, first: &Map, new: &Map, share: f32) {
    let looks = first.values().iter().zip(new.values());
    for (value, (first, new)) in map.values_mut().iter_mut().zip(looks) {
        *value += RATE * (first + share * (new - first) - *value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kernels::Size;

    fn map(value: f32) -> Map {
        let mut map = Map::default();
        map.reshape(Size::square(2), 3).fill(value);
        map
    }

    fn neck(cls: f32, reg: f32) -> TaskMaps {
        TaskMaps {
            cls: map(cls),
            reg: map(reg),
        }
    }

    #[test]
    fn template_after_many_looks_keeps_the_first_ones_share() {
        let mut template = Template::default();
        template.set(&map(7.0), &neck(1.0, 10.0));
        let cls = |template: &Template| template.features().cls.values()[0];

        template.add(&neck(3.0, 10.0), 0.4);
        let once = cls(&template);
        for _ in 0..200 {
            template.add(&neck(3.0, 10.0), 0.4);
        }
        let often = cls(&template);

        // The limit is 0.6 * 1 + 0.4 * 3 = 1.8, and one look goes a tenth of the way.
        assert!((once - 1.08).abs() < 1e-6, "{once}");
        assert!((often - 1.8).abs() < 1e-5, "{often}");
        let reg = template.features().reg.values();
        assert!(reg.iter().all(|v| (v - 10.0).abs() < 1e-5));
        assert_eq!(template.features().identity.values(), [7.0; 12]);
    }

    #[test]
    fn template_set_again_forgets_the_earlier_target() {
        let mut template = Template::default();
        template.set(&map(7.0), &neck(1.0, 10.0));
        template.add(&neck(3.0, 10.0), 0.4);

        template.set(&map(7.0), &neck(1.0, 10.0));

        assert_eq!(template.features().cls.values()[0], 1.0);
    }
}
