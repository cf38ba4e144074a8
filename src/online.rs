//! A filter that is learned while tracking: what tells this target from what is around it.
//!
//! The network was trained on other objects, and its template shows the target alone. This filter has the template's shape and runs
//! over the same features of the search region (the neck's, for classification), but is fitted to the region itself: to
//! respond with a bump at the target and with nothing anywhere else, look-alikes included. Its response is mixed into the score.
//!
//! It solves a ridge regression over a memory of looks, `min over f of sum_k w_k |f * x_k - y_k|^2 + RIDGE |f|^2`, by conjugate
//! gradients, one pass over the memory per frame: a round takes a look into the memory and sums up how far the filter is off,
//! then makes [`STEPS`] steps. Sources: Danelljan et al., ATOM (CVPR 2019), section 3.2; Zhou et al., DROL (AAAI 2020), for
//! the mixture with a Siamese tracker's score. The paper's tracker has none: a share of 0.

use crate::net::Network;
use crate::scratch::Map;
use kernels::filter::{FilterShape, adjoint, respond};
use kernels::{Aligned, Size};

/// Weight of the filter's own size.
const RIDGE: f32 = 0.1;
/// Standard deviation of the bump, in sides of the target.
const SPREAD: f32 = 0.275;
/// Looks that are kept,
const MEMORY: usize = 8;
/// the share of the newest among them,
const RATE: f32 = 0.05;
/// and what the first frame's weight never falls below: it is the only one that is known to show the target.
const FIRST: f32 = 0.25;
/// Steps in the first frame,
const FIRST_STEPS: usize = 20;
/// and in every later round.
const STEPS: u32 = 2;

/// The filter with the looks that it is learned from.
#[derive(Clone, Debug, Default)]
pub(crate) struct OnlineFilter {
    shape: Option<FilterShape>, // none before the first look
    mean: Vec<f32>,             // [C]: of the first look's features
    scale: f32,                 // brings a window of features to a length of about 1
    filter: Aligned<f32>,       // [h, w, C]
    features: Aligned<f32>,     // [H, W, C]: the last look's, less the mean, scaled
    response: Vec<f32>,         // [H', W']
    memory: Vec<Look>,
    solver: Solver,
    turn: u32, // of the round: 0 takes in a look, the others make steps
}

/// One look and what the filter should have said about it.
#[derive(Clone, Debug)]
struct Look {
    features: Aligned<f32>, // [H, W, C]
    label: Vec<f32>,        // [H', W']
    weight: f32,            // in the sum of squares
}

/// What conjugate gradients need room for.
#[derive(Clone, Debug, Default)]
struct Solver {
    response: Vec<f32>,      // [H', W']
    rest: Aligned<f32>,      // [h, w, C]: the normal equations' residual
    direction: Aligned<f32>, // [h, w, C]
    image: Aligned<f32>,     // [h, w, C]: of the direction
    power: f32,              // the residual's square
}

/// Where a target is, in cells of the response.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spot {
    pub row: f32,
    pub column: f32,
    /// The target's side: the root of its area.
    pub side: f32,
}

impl OnlineFilter {
    /// Forgets everything.
    pub(crate) fn clear(&mut self) {
        self.shape = None;
        self.response.clear();
    }

    /// Starts with the network's last look, at the first frame; `spot` says where in the response the target is.
    pub(crate) fn begin(&mut self, network: &Network, spot: impl Fn(&[f32]) -> Spot) {
        let (template, search) = network.classification();
        let shape = FilterShape {
            size: search.size(),
            filter: template.size(),
            channels: search.channels(),
        };
        self.shape = Some(shape);
        self.scale_by(search, shape);
        let out = shape.out_size().area();
        for values in [
            &mut self.filter,
            &mut self.solver.rest,
            &mut self.solver.direction,
        ] {
            values.clear();
            values.resize(shape.filter_len());
        }
        self.solver.image.resize(shape.filter_len());
        self.solver.response.resize(out, 0.0);
        self.memory.resize_with(MEMORY, || Look {
            features: Aligned::default(),
            label: Vec::new(),
            weight: 0.0,
        });
        for look in &mut self.memory {
            look.weight = 0.0;
            look.features.resize(shape.size.area() * shape.channels);
            look.label.resize(out, 0.0);
        }
        self.turn = 0;
        self.take(search, shape);
        self.response.resize(out, 0.0);
        self.remember(shape, 0, spot(&self.response));
        self.memory[0].weight = 1.0;
        self.begin_round(network, shape);
        (0..FIRST_STEPS).for_each(|_| self.step(network, shape));
        self.clear_if_broken();
    }

    /// Responds to the network's last look. Returns what it says, row by row; nothing before the first look.
    pub(crate) fn respond(&mut self, network: &Network) -> &[f32] {
        if let Some(shape) = self.shape {
            let (_, search) = network.classification();
            let shape = FilterShape {
                size: search.size(),
                ..shape
            };
            self.take(search, shape);
            self.response.resize(shape.out_size().area(), 0.0);
            let OnlineFilter {
                filter,
                features,
                response,
                ..
            } = self;
            let threads = network.threads();
            threads.enter(|| {
                respond(
                    network.model().isa(),
                    threads,
                    shape,
                    features,
                    filter,
                    response,
                )
            });
        }
        &self.response
    }

    /// What it said last.
    pub(crate) fn response(&self) -> &[f32] {
        &self.response
    }

    /// Learns from the look that it last responded to; `spot` says where in the response the target is. Looks of another size
    /// than the first one's are passed over.
    pub(crate) fn learn(&mut self, network: &Network, spot: impl Fn(&[f32]) -> Spot) {
        let Some(shape) = self.shape else { return };
        if self.features.len() != shape.size.area() * shape.channels {
            return;
        }
        if self.turn == 0 {
            self.memory
                .iter_mut()
                .for_each(|look| look.weight *= 1.0 - RATE);
            self.memory[0].weight = self.memory[0].weight.max(FIRST);
            // The lightest look makes room: an empty place, or the oldest.
            let weight = |place: &usize| self.memory[*place].weight;
            let lightest = (1..MEMORY).min_by(|a, b| weight(a).total_cmp(&weight(b)));
            let Some(place) = lightest else { return };
            self.remember(shape, place, spot(&self.response));
            self.memory[place].weight = RATE;
            let sum: f32 = self.memory.iter().map(|look| look.weight).sum();
            self.memory.iter_mut().for_each(|look| look.weight /= sum);
            self.begin_round(network, shape);
        } else {
            self.step(network, shape);
        }
        self.turn = (self.turn + 1) % (STEPS + 1);
        self.clear_if_broken();
    }

    /// Features that are not finite would stay in the filter for good: the tracker is better off without one.
    fn clear_if_broken(&mut self) {
        if !self.solver.power.is_finite() {
            self.clear();
        }
    }

    /// Measures the first look's features.
    fn scale_by(&mut self, map: &Map, shape: FilterShape) {
        map.channel_means(&mut self.mean);
        let square = |values: &[f32]| values.iter().map(|v| v * v).sum::<f32>();
        let variance = square(map.values()) / shape.size.area() as f32 - square(&self.mean);
        self.scale = 1.0 / (variance * shape.filter.area() as f32).max(1e-12).sqrt();
    }

    fn take(&mut self, map: &Map, shape: FilterShape) {
        self.features.resize(map.values().len());
        let cells = self.features.chunks_exact_mut(shape.channels);
        for (to, from) in cells.zip(map.values().chunks_exact(shape.channels)) {
            for ((to, from), mean) in to.iter_mut().zip(from).zip(&self.mean) {
                *to = (from - mean) * self.scale;
            }
        }
    }

    /// Puts the last look's features into the memory, with a bump at the target as what to respond.
    fn remember(&mut self, shape: FilterShape, place: usize, spot: Spot) {
        let Look {
            features, label, ..
        } = &mut self.memory[place];
        features.copy_from_slice(&self.features);
        let Size { w, .. } = shape.out_size();
        let spread = 2.0 * (SPREAD * spot.side).max(0.5).powi(2);
        for (i, value) in label.iter_mut().enumerate() {
            let (row, column) = ((i / w) as f32, (i % w) as f32);
            let distance = (row - spot.row).powi(2) + (column - spot.column).powi(2);
            *value = (-distance / spread).exp();
        }
    }

    /// Sums up how far the filter is off, and so where the next step goes: the normal equations' residual,
    /// `sum_k w_k X_k^T (y_k - X_k f) - RIDGE f`.
    fn begin_round(&mut self, network: &Network, shape: FilterShape) {
        let OnlineFilter {
            filter,
            memory,
            solver,
            ..
        } = self;
        let Solver {
            response,
            rest,
            direction,
            power,
            ..
        } = solver;
        let error = |response: f32, label: f32| label - response;
        rest.iter_mut()
            .zip(filter.iter())
            .for_each(|(rest, f)| *rest = -RIDGE * f);
        add_pass(network, shape, memory, filter, response, error, rest);
        direction.copy_from_slice(rest);
        *power = dot(rest, rest);
    }

    /// One step of conjugate gradients toward the filter that fits the memory best.
    fn step(&mut self, network: &Network, shape: FilterShape) {
        let OnlineFilter {
            filter,
            memory,
            solver,
            ..
        } = self;
        let Solver {
            response,
            rest,
            direction,
            image,
            power,
        } = solver;
        if *power < 1e-12 {
            return; // as good as it gets
        }
        image
            .iter_mut()
            .zip(direction.iter())
            .for_each(|(image, d)| *image = RIDGE * d);
        add_pass(
            network,
            shape,
            memory,
            direction,
            response,
            |response, _| response,
            image,
        );
        let length = *power / dot(direction, image);
        filter
            .iter_mut()
            .zip(direction.iter())
            .for_each(|(f, d)| *f += length * d);
        rest.iter_mut()
            .zip(image.iter())
            .for_each(|(rest, image)| *rest -= length * image);
        let next = dot(rest, rest);
        direction
            .iter_mut()
            .zip(rest.iter())
            .for_each(|(d, rest)| *d = rest + next / *power * *d);
        *power = next;
    }
}

/// One pass over the memory: adds `sum_k w_k X_k^T value(X_k f, y_k)` to `out`.
fn add_pass(
    network: &Network,
    shape: FilterShape,
    memory: &[Look],
    filter: &[f32],
    response: &mut [f32],
    value: impl Fn(f32, f32) -> f32 + Sync,
    out: &mut [f32],
) {
    let (isa, threads) = (network.model().isa(), network.threads());
    threads.enter(|| {
        for Look {
            features,
            label,
            weight,
        } in memory.iter().filter(|look| look.weight > 0.0)
        {
            respond(isa, threads, shape, features, filter, response);
            response
                .iter_mut()
                .zip(label)
                .for_each(|(v, label)| *v = weight * value(*v, *label));
            adjoint(isa, threads, shape, features, response, out);
        }
    });
}

fn dot(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Model;
    use kernels::Isa;
    use kernels::reference;
    use weights_format::{Architecture, Weights, Widths};

    const MIDDLE: Spot = Spot {
        row: 11.0,
        column: 11.0,
        side: 8.0,
    };

    /// Blocks of 16 x 16 pixels in colors of their own.
    fn crop(side: usize, seed: usize) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(side * side * 3);
        for i in 0..side * side * 3 {
            let (row, column, color) = (i / 3 / side / 16, i / 3 % side / 16, i % 3);
            let block = ((seed * 64 + row) * 64 + column) * 3 + color;
            let mixed = (block as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            bytes.push(((mixed ^ (mixed >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 56) as u8);
        }
        bytes
    }

    /// A small network that has looked at one picture.
    fn network() -> Network {
        let architecture = Architecture::new(Widths::pruned(0.9), None);
        let weights = Weights::random(architecture, 4);
        let mut network = Network::new(Model::from_weights(&weights, Isa::detect()).unwrap(), 1);
        network.set_template(&crop(architecture.template_size, 1));
        network.search(&crop(architecture.search_size, 1));
        network
    }

    /// The normal equations' residual, in f64 by naive loops, and their right side.
    fn residual(filter: &OnlineFilter) -> (f64, f64) {
        let FilterShape {
            size,
            filter: side,
            channels,
        } = filter.shape.unwrap();
        let (mut rest, mut right): (Vec<f64>, Vec<f64>) = filter
            .filter
            .iter()
            .map(|f| (-f64::from(RIDGE * f), 0.0))
            .unzip();
        for Look {
            features,
            label,
            weight,
        } in &filter.memory
        {
            let response = reference::filter(size, side, channels, features, &filter.filter);
            let error: Vec<f32> = response
                .iter()
                .zip(label)
                .map(|(r, label)| weight * (label - *r as f32))
                .collect();
            let label: Vec<f32> = label.iter().map(|label| weight * label).collect();
            for (sum, values) in [(&mut rest, error), (&mut right, label)] {
                let terms = reference::filter_adjoint(size, side, channels, features, &values);
                sum.iter_mut()
                    .zip(terms)
                    .for_each(|(sum, term)| *sum += term);
            }
        }
        let norm = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        (norm(&rest), norm(&right))
    }

    #[test]
    fn conjugate_gradients_solve_the_normal_equations() {
        let mut network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);
        let side = network.model().architecture().search_size;
        for seed in [5, 9, 11, 12] {
            network.search(&crop(side, seed));
            filter.respond(&network);
            filter.learn(&network, |_| Spot { row: 8.0, ..MIDDLE });
        }
        assert_eq!(
            filter
                .memory
                .iter()
                .filter(|look| look.weight > 0.0)
                .count(),
            3,
            "every third look is kept"
        );
        let shape = filter.shape.unwrap();
        let (before, right) = residual(&filter);
        (0..300).for_each(|_| filter.step(&network, shape));
        let (after, _) = residual(&filter);
        assert!(
            after < 1e-3 * right && after < before,
            "{before}, then {after} of {right}"
        );
    }

    #[test]
    fn it_responds_at_the_target_and_not_elsewhere() {
        let network = network();
        let mut filter = OnlineFilter::default();
        assert!(filter.respond(&network).is_empty(), "nothing is known yet");
        let spot = Spot {
            row: 7.0,
            column: 14.0,
            side: 6.0,
        };
        filter.begin(&network, |_| spot);
        let response = filter.respond(&network).to_vec();
        let best = (0..response.len())
            .max_by(|a, b| response[*a].total_cmp(&response[*b]))
            .unwrap();
        assert!(
            (best / 23).abs_diff(7) <= 1 && (best % 23).abs_diff(14) <= 1,
            "peak at {best}"
        );
        assert!(response[best] > 0.5, "{}", response[best]);
        let away = |i: usize| (i / 23).abs_diff(7).max((i % 23).abs_diff(14));
        let elsewhere = (0..response.len())
            .filter(|i| away(*i) > 4)
            .map(|i| response[i])
            .fold(0.0, f32::max);
        assert!(
            response[best] > 3.0 * elsewhere,
            "{} and {elsewhere} elsewhere",
            response[best]
        );
        filter.clear();
        assert!(filter.respond(&network).is_empty());
    }

    #[test]
    fn features_that_are_not_finite_end_it() {
        let network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);
        assert!(!filter.respond(&network).is_empty());
        filter.features[5] = f32::NAN;
        filter.learn(&network, |_| MIDDLE);
        assert!(filter.respond(&network).is_empty());
    }

    #[test]
    fn the_first_look_keeps_its_weight_and_old_ones_go() {
        let network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);
        for _ in 0..200 {
            filter.learn(&network, |_| MIDDLE);
        }
        let sum: f32 = filter.memory.iter().map(|look| look.weight).sum();
        assert!(
            (sum - 1.0).abs() < 1e-4 && filter.memory[0].weight > FIRST - 0.01,
            "{:?}",
            filter.memory[0].weight
        );
        assert!(filter.memory.iter().all(|look| look.weight > 0.0));
        assert!(filter.filter.iter().all(|f| f.is_finite()));
    }
}
