//! How the tracker runs: model, threads, instruction set, arithmetic, mode.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use track_cpu::{Cores, Isa, Model, ModelError, Precision, SearchRegion, TrackerOptions};
use weights_format::{Calibration, LayerKind, Range, Weights};

use super::values::{cores, isa, precision, share, threads};

/// Which model.
#[derive(Debug, clap::Args)]
pub struct ModelArg {
    #[doc = "The model."]
    #[arg(short, long, value_name = "FILE|NAME", help = model_help())]
    pub model: Option<PathBuf>,
}

impl ModelArg {
    /// The name or file that was given.
    pub fn name(&self) -> Option<&Path> {
        self.model.as_deref()
    }
}

/// The help of every option that names a model.
pub fn model_help() -> String {
    let names: Vec<&str> = Model::builtin_names().collect();
    let (names, first) = (names.join(", "), names[0]);
    format!("Weights file, or a built-in model: {names} [default: {first}]")
}

/// How the network runs.
#[derive(Debug, clap::Args)]
pub struct EngineArgs {
    /// Threads that work on one frame.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = threads)]
    pub threads: usize,
    /// Processor cores for these threads, in turn, as in 2,3 or 4-7 [default: the system decides;
    /// with as many threads as cores, one on each].
    #[arg(long, value_name = "CORES", value_parser = cores)]
    pub pin: Option<Cores>,
    /// Instruction set, of those that `track-cpu doctor` lists [default: the fastest].
    #[arg(long, value_name = "NAME", value_parser = isa)]
    pub isa: Option<Isa>,
    /// Arithmetic of the network: f32, or int8 (integers of 8 and 16 bits) for a calibrated model
    /// [default: int8 if the model allows it and the processor multiplies integers faster].
    #[arg(long, value_name = "NAME", value_parser = precision)]
    pub precision: Option<Precision>,
    /// Track as published: without first-frame correction, template update, online filter,
    /// stretched search regions and voting.
    #[arg(
        long,
        conflicts_with_all = [
            "correction",
            "template_update",
            "online_filter",
            "unstretch",
            "voting",
        ]
    )]
    pub as_published: bool,
    /// Share of the network's error in the first frame that is taken out of later boxes, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share, hide = true)]
    pub correction: Option<f64>,
    /// Share of the target's later looks in the template, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share, hide = true)]
    pub template_update: Option<f64>,
    /// Share of the filter that is learned while tracking in the score, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share, hide = true)]
    pub online_filter: Option<f64>,
    /// Share of the target's change of aspect that the search region takes back, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share, hide = true)]
    pub unstretch: Option<f64>,
    /// Share of the vote of neighboring cells in the reported box, 0 to 1.
    #[arg(long, value_name = "SHARE", value_parser = share, hide = true)]
    pub voting: Option<f64>,
    /// How much of the search region is looked at.
    #[arg(long, value_name = "HOW", value_enum, default_value_t = Search::Full)]
    pub search: Search,
}

/// How much of the search region is looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Search {
    /// All of it, in every frame.
    #[default]
    Full,
    /// Its middle while the target is easy to follow; not in flight mode.
    Auto,
}

impl EngineArgs {
    /// The instruction set asked for, or the fastest.
    pub fn isa(&self) -> Isa {
        self.isa.unwrap_or_else(Isa::detect)
    }

    /// The model that [`Model::find`] finds, as it is to run.
    pub fn model(&self, name: Option<&Path>) -> Result<Model, ModelError> {
        if let Some((old, new)) = name.and_then(|old| Some((old, Model::successor(old)?))) {
            let old = old.display();
            eprintln!("note: {old} is no longer built in; {new} takes its place");
        }
        self.model_of(&Model::find(name)?)
    }

    /// Weights as they are to run.
    pub fn model_of(&self, weights: &Weights) -> Result<Model, ModelError> {
        let precision = self
            .precision
            .unwrap_or_else(|| Precision::best(weights, self.isa()));
        let published = self.as_published.then_some(0.0);
        let shares = [
            self.correction,
            self.template_update,
            self.online_filter,
            self.unstretch,
            self.voting,
        ];
        let shares = shares.map(|share| share.or(published));
        if shares == [None; 5] {
            return Model::with_precision(weights, self.isa(), precision);
        }
        let mut weights = weights.clone();
        let tracker = &mut weights.header.tracker;
        let [
            correction,
            template_update,
            online_filter,
            unstretch,
            voting,
        ] = shares;
        tracker.correction = correction.unwrap_or(tracker.correction);
        tracker.template_update = template_update.unwrap_or(tracker.template_update);
        tracker.online_filter = online_filter.unwrap_or(tracker.online_filter);
        tracker.unstretch = unstretch.unwrap_or(tracker.unstretch);
        tracker.voting = voting.unwrap_or(tracker.voting);
        Model::with_precision(&weights, self.isa(), precision)
    }

    /// The cores to run on.
    pub fn cores(&self) -> Cores {
        self.pin.unwrap_or_default()
    }

    /// How a tracker of the model is to run.
    pub fn options(&self, model: &Model) -> TrackerOptions {
        let search = match self.search {
            Search::Full => SearchRegion::Full,
            Search::Auto => SearchRegion::Adaptive,
        };
        TrackerOptions {
            threads: self.threads,
            cores: self.cores(),
            search,
            ..TrackerOptions::of(model)
        }
    }

    /// Random weights as they are to run; int8 only if asked for, with made-up ranges.
    pub fn random_model(&self, mut weights: Weights) -> Result<Model, ModelError> {
        let layers = weights.header.architecture.layers().into_iter();
        let convs = layers.filter(|layer| layer.kind == LayerKind::Conv && layer.kernel > 1);
        let range = Range {
            low: -4.0,
            high: 4.0,
        };
        let inputs: BTreeMap<_, _> = convs.map(|layer| (layer.name, range)).collect();
        weights.header.calibration = Some(Calibration {
            method: "none".into(),
            inputs,
        });
        let precision = self.precision.unwrap_or(Precision::F32);
        Model::with_precision(&weights, self.isa(), precision)
    }
}

/// What follows the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// The tracker alone: it always finds something.
    #[value(alias = "paper")]
    Plain,
    /// Knows when the target is lost, coasts, and finds it again.
    Flight,
}

impl Mode {
    /// The name on the command line and in flight logs.
    #[cfg(feature = "serve")]
    pub fn name(self) -> &'static str {
        match self {
            Mode::Plain => "plain",
            Mode::Flight => "flight",
        }
    }

    /// The mode of this name.
    #[cfg(feature = "serve")]
    pub fn from_name(name: &str) -> Option<Mode> {
        Mode::from_str(name, false).ok()
    }
}
