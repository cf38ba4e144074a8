//! The disentangled-representation module at inference: encoder E2, which keeps the identity-related features.
//! Its twin E1 exists in training only.

use crate::scratch::{Context, Map};
use kernels::conv::Conv;
use kernels::par::Threads;

/// E2's convolutions for each branch: both empty where the model has none here, so that features pass through.
#[derive(Debug, Default)]
pub(crate) struct Dr {
    pub template: Vec<Conv>,
    pub search: Option<Vec<Conv>>, // where the search branch has weights of its own
}

/// What each of at most two convolutions leaves behind.
pub(crate) type DrMaps = [Map; 2];

impl Dr {
    /// Whether template and search region go through the same weights.
    pub(crate) fn is_shared(&self) -> bool {
        self.search.is_none()
    }

    /// The identity-related features of the template.
    pub(crate) fn template<'a>(
        &self,
        context: &mut Context,
        threads: &Threads,
        features: &'a Map,
        maps: &'a mut DrMaps,
    ) -> &'a Map {
        run(&self.template, context, threads, features, maps)
    }

    /// The identity-related features of the search region.
    pub(crate) fn search<'a>(
        &self,
        context: &mut Context,
        threads: &Threads,
        features: &'a Map,
        maps: &'a mut DrMaps,
    ) -> &'a Map {
        run(
            self.search.as_ref().unwrap_or(&self.template),
            context,
            threads,
            features,
            maps,
        )
    }

    /// What [`search`](Self::search) returned last.
    pub(crate) fn search_features<'a>(&self, features: &'a Map, maps: &'a DrMaps) -> &'a Map {
        match self.search.as_ref().unwrap_or(&self.template).len() {
            0 => features,
            n => &maps[n.min(maps.len()) - 1],
        }
    }
}

fn run<'a>(
    convs: &[Conv],
    context: &mut Context,
    threads: &Threads,
    features: &'a Map,
    [first_map, second_map]: &'a mut DrMaps,
) -> &'a Map {
    let [first, rest @ ..] = convs else {
        return features;
    };
    context.conv(threads, first, features, first_map);
    let [second] = rest else { return first_map };
    context.conv(threads, second, first_map, second_map);
    second_map
}
