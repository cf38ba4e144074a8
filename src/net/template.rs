//! What the target looks like: the first frame's template, and beside it, as far as the model asks, the frames since.
//!
//! The response is linear in the template, so a mean of templates looks for all of them at once. The first frame's part never
//! goes: it is the only one that is known to show the target.

use crate::scratch::Map;

/// The template's neck features, correlated with every search region.
#[derive(Clone, Debug, Default)]
pub struct TemplateFeatures {
    /// For classification: 4x4 for the standard template.
    pub cls: Map,
    /// For regression.
    pub reg: Map,
    /// Identity-related, before the neck (E2, or conv5 where there is no E2), of the first frame: 6x6 for the standard
    /// template.
    pub identity: Map,
}

/// Share of one frame in the looks since the first: they are forgotten over ten frames.
const RATE: f32 = 0.1;

/// The template with its first frame's part.
#[derive(Clone, Debug, Default)]
pub(crate) struct Template {
    features: TemplateFeatures,
    first: [Map; 2], // cls and reg
}

impl Template {
    /// What search regions are correlated with.
    pub(crate) fn features(&self) -> &TemplateFeatures {
        &self.features
    }

    /// Starts anew with the first frame: its identity-related features, `cls` and `reg`.
    pub(crate) fn set(&mut self, identity: &Map, [cls, reg]: [&Map; 2]) {
        self.features = TemplateFeatures {
            cls: cls.clone(),
            reg: reg.clone(),
            identity: identity.clone(),
        };
        self.first = [cls.clone(), reg.clone()];
    }

    /// Moves toward `(1 - share) * first + share * new`, so that in the end `share` of the template are later looks.
    pub(crate) fn add(&mut self, [cls, reg]: [&Map; 2], share: f32) {
        let [first_cls, first_reg] = &self.first;
        for (map, first, new) in [
            (&mut self.features.cls, first_cls, cls),
            (&mut self.features.reg, first_reg, reg),
        ] {
            for ((value, first), new) in map
                .values_mut()
                .iter_mut()
                .zip(first.values())
                .zip(new.values())
            {
                *value += RATE * (first + share * (new - first) - *value);
            }
        }
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

    #[test]
    fn the_first_look_keeps_its_share() {
        let mut template = Template::default();
        template.set(&map(7.0), [&map(1.0), &map(10.0)]);
        let cls = |template: &Template| template.features().cls.values()[0];
        template.add([&map(3.0), &map(10.0)], 0.4);
        assert!((cls(&template) - 1.08).abs() < 1e-6, "{}", cls(&template)); // a tenth of the way to 1.8
        for _ in 0..200 {
            template.add([&map(3.0), &map(10.0)], 0.4);
        }
        assert!((cls(&template) - 1.8).abs() < 1e-5, "{}", cls(&template));
        assert!(
            template
                .features()
                .reg
                .values()
                .iter()
                .all(|v| (v - 10.0).abs() < 1e-5)
        );
        assert_eq!(template.features().identity.values(), [7.0; 12]);
        template.set(&map(7.0), [&map(1.0), &map(10.0)]);
        assert_eq!(cls(&template), 1.0, "the new target's first look alone");
    }
}
