//! A correlation filter that is learned while tracking: this target against its surroundings.
//!
//! The network was trained on other objects, and its template shows the target alone. This filter
//! has the template's shape and runs over the same features of the search region (the neck's, for
//! classification), but it is fitted to the region itself: it responds with a bump at the target
//! and with nothing elsewhere, distractors included. Its response is mixed into the score.
//!
//! The filter solves a ridge regression over a memory of samples,
//! `min over f of sum_k w_k |f * x_k - y_k|^2 + RIDGE |f|^2`, by conjugate gradients. One call of
//! [`OnlineFilter::learn`] makes one pass over the memory. A round of `1 + STEPS` calls stores a
//! sample and computes the residual, then makes [`STEPS`] steps.
//!
//! Sources: Danelljan et al., ATOM (CVPR 2019), section 3.2; Zhou et al., DROL (AAAI 2020), for the
//! mixture with a Siamese tracker's score; docs/method.md, section 5.3.
//! The published tracker has no filter: a share of 0.

use crate::net::{Map, Network};
use kernels::filter::{FilterShape, adjoint, respond};
use kernels::{Aligned, Size};

/// Weight of the filter's own norm.
const RIDGE: f32 = 0.1;
/// Standard deviation of the bump, in sides of the target.
const SPREAD: f32 = 0.275;
/// Samples in the memory.
const MEMORY: usize = 8;
/// Weight of the newest sample.
const RATE: f32 = 0.05;
/// Least weight of the first frame's sample, the only one known to show the target.
const FIRST: f32 = 0.25;
/// Steps in the first frame.
const FIRST_STEPS: usize = 20;
/// Steps in every later round.
const STEPS: u32 = 2;
/// Squared residual below which a step is a no-op.
const CONVERGED: f32 = 1e-12;

/// The filter with its memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct OnlineFilter {
    shape: Option<FilterShape>, // `None` before the first sample
    mean: Vec<f32>,             // [C]: of the first sample's features
    scale: f32,                 // brings a window of features to a norm of about 1
    filter: Aligned<f32>,       // [h, w, C]
    features: Aligned<f32>,     // [H, W, C]: the last search's, less the mean, scaled
    response: Vec<f32>,         // [H', W']
    memory: Vec<Sample>,
    solver: Solver,
    turn: u32, // of the round: 0 stores a sample, the others make steps
}

/// Features of one search and the response that the filter should give.
#[derive(Clone, Debug)]
struct Sample {
    features: Aligned<f32>, // [H, W, C]
    label: Vec<f32>,        // [H', W']
    weight: f32,            // in the sum of squares; 0 for an empty place
}

/// State of the conjugate gradients.
#[derive(Clone, Debug, Default)]
struct Solver {
    response: Vec<f32>,      // [H', W']
    residual: Aligned<f32>,  // [h, w, C]: of the normal equations
    direction: Aligned<f32>, // [h, w, C]
    image: Aligned<f32>,     // [h, w, C]: the normal matrix times the direction
    power: f32,              // square of the residual
}

/// A target's place in the response, in cells.
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

    /// Starts with the network's last search, of the first frame.
    ///
    /// `spot` maps a response to the target's place in it.
    pub(crate) fn begin(&mut self, network: &Network, spot: impl Fn(&[f32]) -> Spot) {
        let (template, search) = network.classification();
        let shape = FilterShape {
            size: search.size(),
            filter: template.size(),
            channels: search.channels(),
        };
        self.shape = Some(shape);
        self.measure_scale(search, shape);
        self.make_room(shape);

        // The first sample has the memory to itself and is fitted at once.
        self.turn = 0;
        self.load(search, shape);
        self.response.resize(shape.out_size().area(), 0.0);
        self.store(shape, 0, spot(&self.response));
        self.memory[0].weight = 1.0;
        self.begin_round(network, shape);
        for _ in 0..FIRST_STEPS {
            self.step(network, shape);
        }
        self.clear_if_broken();
    }

    /// Sizes every buffer and empties the memory.
    fn make_room(&mut self, shape: FilterShape) {
        let out = shape.out_size().area();
        for values in [
            &mut self.filter,
            &mut self.solver.residual,
            &mut self.solver.direction,
        ] {
            values.clear();
            values.resize(shape.filter_len());
        }
        self.solver.image.resize(shape.filter_len());
        self.solver.response.resize(out, 0.0);
        self.memory.resize_with(MEMORY, || Sample {
            features: Aligned::default(),
            label: Vec::new(),
            weight: 0.0,
        });
        for sample in &mut self.memory {
            sample.weight = 0.0;
            sample.features.resize(shape.size.area() * shape.channels);
            sample.label.resize(out, 0.0);
        }
    }

    /// Responds to the network's last search, row by row; empty before the first sample.
    pub(crate) fn respond(&mut self, network: &Network) -> &[f32] {
        if let Some(shape) = self.shape {
            let (_, search) = network.classification();
            let shape = FilterShape {
                size: search.size(),
                ..shape
            };
            self.load(search, shape);
            self.response.resize(shape.out_size().area(), 0.0);
            let OnlineFilter {
                filter,
                features,
                response,
                ..
            } = self;
            let isa = network.model().isa();
            let threads = network.threads();
            threads.enter(|| respond(isa, threads, shape, features, filter, response));
        }
        &self.response
    }

    /// The last response.
    pub(crate) fn response(&self) -> &[f32] {
        &self.response
    }

    /// Learns from the search that it last responded to.
    ///
    /// `spot` maps a response to the target's place in it. Searches of another size than the first
    /// one's are skipped.
    pub(crate) fn learn(&mut self, network: &Network, spot: impl Fn(&[f32]) -> Spot) {
        let Some(shape) = self.shape else { return };
        if self.features.len() != shape.size.area() * shape.channels {
            return;
        }
        if self.turn == 0 {
            self.remember(shape, spot(&self.response));
            self.begin_round(network, shape);
        } else {
            self.step(network, shape);
        }
        self.turn = (self.turn + 1) % (STEPS + 1);
        self.clear_if_broken();
    }

    /// Features that are not finite would stay in the filter for good; no filter is better.
    fn clear_if_broken(&mut self) {
        if !self.solver.power.is_finite() {
            self.clear();
        }
    }

    /// Measures the mean and the scale of the first search's features.
    fn measure_scale(&mut self, map: &Map, shape: FilterShape) {
        map.channel_means(&mut self.mean);
        let square = |values: &[f32]| values.iter().map(|v| v * v).sum::<f32>();
        let variance = square(map.values()) / shape.size.area() as f32 - square(&self.mean);
        self.scale = 1.0 / (variance * shape.filter.area() as f32).max(1e-12).sqrt();
    }

    /// Loads a search's features, less the mean, scaled.
    fn load(&mut self, map: &Map, shape: FilterShape) {
        self.features.resize(map.values().len());
        let cells = self.features.chunks_exact_mut(shape.channels);
        for (to, from) in cells.zip(map.values().chunks_exact(shape.channels)) {
            for ((to, from), mean) in to.iter_mut().zip(from).zip(&self.mean) {
                *to = (from - mean) * self.scale;
            }
        }
    }

    /// Fades the memory and stores the loaded features in place of the lightest sample, which is an
    /// empty place or the oldest sample.
    fn remember(&mut self, shape: FilterShape, spot: Spot) {
        for sample in &mut self.memory {
            sample.weight *= 1.0 - RATE;
        }
        self.memory[0].weight = self.memory[0].weight.max(FIRST);
        let mut place = 1;
        for i in 2..MEMORY {
            if self.memory[i].weight < self.memory[place].weight {
                place = i;
            }
        }
        self.store(shape, place, spot);
        self.memory[place].weight = RATE;
        let sum: f32 = self.memory.iter().map(|sample| sample.weight).sum();
        for sample in &mut self.memory {
            sample.weight /= sum;
        }
    }

    /// Stores the loaded features, labeled with a bump at the target.
    fn store(&mut self, shape: FilterShape, place: usize, spot: Spot) {
        let Sample {
            features, label, ..
        } = &mut self.memory[place];
        features.copy_from_slice(&self.features);
        let Size { w, .. } = shape.out_size();
        let spread = 2.0 * (SPREAD * spot.side).max(0.5).powi(2);
        for (i, value) in label.iter_mut().enumerate() {
            let row = (i / w) as f32;
            let column = (i % w) as f32;
            let distance = (row - spot.row).powi(2) + (column - spot.column).powi(2);
            *value = (-distance / spread).exp();
        }
    }

    /// Computes the residual of the normal equations, which is also the first direction:
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
            residual,
            direction,
            power,
            ..
        } = solver;
        let error = |response: f32, label: f32| label - response;
        for (residual, f) in residual.iter_mut().zip(filter.iter()) {
            *residual = -RIDGE * f;
        }
        add_pass(network, shape, memory, filter, response, error, residual);
        direction.copy_from_slice(residual);
        *power = dot(residual, residual);
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
            residual,
            direction,
            image,
            power,
        } = solver;
        if *power < CONVERGED {
            return;
        }

        // image = (sum_k w_k X_k^T X_k + RIDGE) direction
        for (image, d) in image.iter_mut().zip(direction.iter()) {
            *image = RIDGE * d;
        }
        let linear = |response: f32, _: f32| response;
        add_pass(network, shape, memory, direction, response, linear, image);

        // Go along the direction to the minimum, then turn conjugate to it.
        let length = *power / dot(direction, image);
        for (f, d) in filter.iter_mut().zip(direction.iter()) {
            *f += length * d;
        }
        for (residual, image) in residual.iter_mut().zip(image.iter()) {
            *residual -= length * image;
        }
        let next = dot(residual, residual);
        for (d, residual) in direction.iter_mut().zip(residual.iter()) {
            *d = residual + next / *power * *d;
        }
        *power = next;
    }
}

/// One pass over the memory: adds `sum_k w_k X_k^T value(X_k f, y_k)` to `out`.
fn add_pass(
    network: &Network,
    shape: FilterShape,
    memory: &[Sample],
    filter: &[f32],
    response: &mut [f32],
    value: impl Fn(f32, f32) -> f32 + Sync,
    out: &mut [f32],
) {
    let isa = network.model().isa();
    let threads = network.threads();
    threads.enter(|| {
        for sample in memory.iter().filter(|sample| sample.weight > 0.0) {
            respond(isa, threads, shape, &sample.features, filter, response);
            for (v, label) in response.iter_mut().zip(&sample.label) {
                *v = sample.weight * value(*v, *label);
            }
            adjoint(isa, threads, shape, &sample.features, response, out);
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

    /// A small network that has searched one picture.
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
        for Sample {
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
    fn steps_solve_the_normal_equations() {
        let mut network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);
        let side = network.model().architecture().search_size;
        for seed in [5, 9, 11, 12] {
            network.search(&crop(side, seed));
            filter.respond(&network);
            filter.learn(&network, |_| Spot { row: 8.0, ..MIDDLE });
        }
        let shape = filter.shape.unwrap();
        let (before, right) = residual(&filter);

        for _ in 0..300 {
            filter.step(&network, shape);
        }

        let (after, _) = residual(&filter);
        assert!(after < 1e-3 * right, "{after} of {right}");
        assert!(after < before, "{before}, then {after}");
    }

    #[test]
    fn learn_stores_every_third_search() {
        let network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);
        filter.respond(&network);

        for _ in 0..4 {
            filter.learn(&network, |_| MIDDLE);
        }

        let stored = filter.memory.iter().filter(|sample| sample.weight > 0.0);
        assert_eq!(stored.count(), 3, "the first search, and two of four");
    }

    #[test]
    fn filter_of_one_sample_responds_at_the_target_only() {
        let network = network();
        let mut filter = OnlineFilter::default();
        let spot = Spot {
            row: 7.0,
            column: 14.0,
            side: 6.0,
        };
        filter.begin(&network, |_| spot);

        let response = filter.respond(&network).to_vec();

        // Distance of a cell of the 23 x 23 response from the spot, along the farther axis.
        let away = |i: usize| (i / 23).abs_diff(7).max((i % 23).abs_diff(14));
        let mut best = 0;
        let mut elsewhere: f32 = 0.0;
        for (i, value) in response.iter().enumerate() {
            if *value > response[best] {
                best = i;
            }
            if away(i) > 4 {
                elsewhere = elsewhere.max(*value);
            }
        }
        assert!(away(best) <= 1, "peak at {best}");
        assert!(response[best] > 0.5, "{}", response[best]);
        assert!(response[best] > 3.0 * elsewhere, "{elsewhere} elsewhere");
    }

    #[test]
    fn filter_before_its_first_sample_or_after_clear_responds_nothing() {
        let network = network();
        let mut filter = OnlineFilter::default();
        assert!(filter.respond(&network).is_empty());
        filter.begin(&network, |_| MIDDLE);
        assert!(!filter.respond(&network).is_empty());

        filter.clear();

        assert!(filter.respond(&network).is_empty());
    }

    #[test]
    fn features_that_are_not_finite_clear_the_filter() {
        let network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);
        assert!(!filter.respond(&network).is_empty());
        filter.features[5] = f32::NAN;

        filter.learn(&network, |_| MIDDLE);

        assert!(filter.respond(&network).is_empty());
    }

    #[test]
    fn first_sample_after_many_keeps_its_weight() {
        let network = network();
        let mut filter = OnlineFilter::default();
        filter.begin(&network, |_| MIDDLE);

        for _ in 0..200 {
            filter.learn(&network, |_| MIDDLE);
        }

        let weights: Vec<f32> = filter.memory.iter().map(|sample| sample.weight).collect();
        let sum: f32 = weights.iter().sum();
        assert!((sum - 1.0).abs() < 1e-4, "{weights:?}");
        assert!(weights[0] > FIRST - 0.01, "{weights:?}");
        assert!(weights.iter().all(|weight| *weight > 0.0), "{weights:?}");
        assert!(filter.filter.iter().all(|f| f.is_finite()));
    }
}
