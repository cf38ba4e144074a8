//! Opens runs and networks from files.

use super::{DataOptions, Fit, FitOptions, Position, checkpoint};
use crate::error::Error;
use crate::network::StatisticsNets;
use autodiff::Tensor;
use std::path::{Path, PathBuf};
use weights_format::{Architecture, Unfolded, Weights};

impl Fit {
    /// Resumes the run of a checkpoint.
    ///
    /// # Errors
    /// If the file is not a checkpoint, or does not have every tensor of its network.
    pub fn resume(path: &Path) -> Result<Fit, Error> {
        let (position, state) = checkpoint::load(path)?;
        let mut fit = Fit::empty(position)?;
        let wrong = |found: &dyn ToString| {
            Error::file(path, "every tensor of its network", found.to_string())
        };
        let expected = fit.parameters.iter().len();
        if state.parameters.len() != expected {
            return Err(wrong(&format!(
                "{} tensors in place of {expected}",
                state.parameters.len()
            )));
        }
        for (name, value) in state.parameters {
            fit.parameters
                .restore(&name, value)
                .map_err(|error| wrong(&error))?;
        }
        for (name, value) in state.optimizer {
            fit.optimizer
                .restore(&fit.parameters, &name, value)
                .map_err(|error| wrong(&error))?;
        }
        if !state.averages.is_empty() {
            let mut averages = fit.parameters.clone();
            for (name, value) in state.averages {
                averages
                    .restore(&name, value)
                    .map_err(|error| wrong(&error))?;
            }
            fit.averages = averages.iter().map(|p| p.value.clone()).collect();
        }
        Ok(fit)
    }

    /// Opens the deployed network of any file that holds one: a checkpoint, parameters from
    /// `convert --to trainer`, or a weights file.
    ///
    /// # Errors
    /// If the file has none of these formats, or is incomplete.
    pub fn open(path: &Path) -> Result<Fit, Error> {
        match checkpoint::form(path)? {
            checkpoint::Form::Checkpoint => {
                let mut fit = Fit::resume(path)?;
                fit.parameters = fit.deployed();
                fit.averages.clear();
                Ok(fit)
            }
            checkpoint::Form::Unfolded => {
                let unfolded = Unfolded::read(path)?;
                let mut fit = Fit::around(unfolded.architecture)?;
                fit.network
                    .import_unfolded(&mut fit.parameters, &unfolded)?;
                fit.position.history.push(unfolded.source);
                Ok(fit)
            }
            checkpoint::Form::Weights => {
                let weights = Weights::read(path)?;
                let mut fit = Fit::around(weights.header.architecture)?;
                fit.network.import(&mut fit.parameters, &weights)?;
                fit.folded = true;
                let provenance = &weights.header.provenance;
                fit.position.history.push(format!(
                    "weights {}, {}",
                    provenance.name, provenance.source
                ));
                Ok(fit)
            }
        }
    }

    /// Averages the deployed parameters of several networks of one shape. The result is a fresh run
    /// with the options and data of the first one.
    ///
    /// If one run starts from the end of another one, the mean of both ends is often better than
    /// either (Wortsman et al., "Model soups", ICML 2022).
    ///
    /// # Errors
    /// If a file holds no network, or a network whose shape differs from the first one's.
    pub fn mean(first: &Path, others: &[PathBuf]) -> Result<Fit, Error> {
        let mut mean = Fit::open(first)?;
        let mut history = vec![format!("the mean of {} networks", 1 + others.len())];
        history.extend(mean.history());
        let share = 1.0 / (1 + others.len()) as f32;
        mean.parameters
            .iter_mut()
            .for_each(|p| p.value.data_mut().iter_mut().for_each(|v| *v *= share));
        for path in others {
            let other = Fit::open(path)?;
            let alike = other.folded == mean.folded
                && other.parameters.iter().len() == mean.parameters.iter().len();
            for parameter in mean.parameters.iter_mut() {
                let name = parameter.name();
                let value = other
                    .parameters
                    .find(name)
                    .map(|id| &other.parameters[id].value);
                let value = value.filter(|value| alike && value.shape() == parameter.value.shape());
                let value = value.ok_or_else(|| {
                    Error::file(
                        path,
                        format!("a network of the shape of {}", first.display()),
                        name,
                    )
                })?;
                let terms = parameter.value.data_mut().iter_mut().zip(value.data());
                terms.for_each(|(sum, v)| *sum += share * v);
            }
            history.extend(
                other
                    .history()
                    .into_iter()
                    .filter(|line| !history.contains(line))
                    .collect::<Vec<_>>(),
            );
        }
        let Position {
            options,
            data,
            data_options,
            ..
        } = mean.position;
        mean.position = Position::start(options, data, data_options);
        mean.position.history = history;
        mean.begin_averages();
        Ok(mean)
    }

    /// A run of default options that begins with an architecture.
    fn around(architecture: Architecture) -> Result<Fit, Error> {
        let mut options = FitOptions {
            architecture,
            ..FitOptions::cpu()
        };
        if architecture.encoder.is_none() {
            options.statistics_nets = StatisticsNets::None;
            options.losses.identity = 0.0;
        }
        Fit::start(options, Vec::new(), DataOptions::default())
    }

    /// A fresh run with given parameters.
    ///
    /// # Errors
    /// If an option is out of range, or the parameters are not those of the network.
    pub fn with_parameters(
        position: Position,
        parameters: impl IntoIterator<Item = (String, Tensor)>,
    ) -> Result<Fit, Error> {
        let Position {
            options,
            data,
            data_options,
            history,
            ..
        } = position;
        let mut fit = Fit::start(options, data, data_options)?;
        fit.position.history = history;
        for (name, value) in parameters {
            let restored = fit.parameters.restore(&name, value);
            restored.map_err(|error| Error::option("parameters", "those of the network", error))?;
        }
        fit.begin_averages();
        Ok(fit)
    }

    /// Sets the data of a fresh run.
    pub fn train_on(&mut self, data: Vec<String>, data_options: DataOptions) {
        self.position.data = data;
        self.position.data_options = data_options;
    }

    /// Copies the parameters of another network that match in name and shape. Returns the names of
    /// the others.
    pub fn take_over(&mut self, other: &Fit) -> Vec<String> {
        let mut fresh = Vec::new();
        let names: Vec<_> = self
            .parameters
            .iter()
            .map(|p| p.name().to_owned())
            .collect();
        for name in names {
            let value = other
                .parameters
                .find(&name)
                .map(|id| other.parameters[id].value.clone());
            if value.is_none_or(|value| self.parameters.restore(&name, value).is_err()) {
                fresh.push(name);
            }
        }
        self.folded = other.folded;
        self.position.history = other.history();
        self.begin_averages();
        fresh
    }

    /// What was done to the parameters so far, this run included, one sentence per run.
    pub fn history(&self) -> Vec<String> {
        let Position {
            options,
            data,
            data_options,
            step,
            seconds,
            history,
            ..
        } = &self.position;
        let mut all = history.clone();
        if *step > 0 {
            let (batch, hours, seed) = (options.batch, seconds / 3600.0, data_options.seed);
            all.push(format!(
                "{step} steps of {batch} pairs in {hours:.2} h, data {}, seed {seed}",
                data.join(" ")
            ));
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::Dataset;
    use crate::fit::{Budget, compute, crops_of};
    use crate::testing::{Folder, pictures};
    use autodiff::{Mode, Tape};
    use std::sync::Arc;
    use weights_format::{Encoder, InputNormalization, Storage, Widths};

    fn tiny() -> Fit {
        let widths = Widths::uniform([4, 6, 8, 8, 8], 8);
        let architecture = Architecture {
            search_size: 191,
            ..Architecture::new(widths, Some(Encoder::standard(8)))
        };
        let budget = Budget::Steps(1);
        let options = FitOptions {
            architecture,
            early_size: 191,
            batch: 2,
            budget,
            ..FitOptions::cpu()
        };
        Fit::start(options, vec!["scenes".into()], DataOptions::default()).unwrap()
    }

    fn outputs(fit: &Fit, dataset: &Dataset) -> Vec<f32> {
        let compute = compute(2).unwrap();
        let samples: Vec<_> = (0..2).map(|i| dataset.sample(i, 191)).collect();
        let (template, search) = crops_of(&samples, fit.network().architecture());
        let mut parameters = fit.deployed();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Evaluation);
        let found = fit.network().predict(&mut tape, template, search);
        let offsets = tape.value(found.offsets).data().iter();
        // Behind the scalars, which a weights file has folded in.
        let scalar = |name: &str| {
            fit.parameters()[fit.parameters().find(name).unwrap()]
                .value
                .item()
        };
        let decoded: Vec<f32> = offsets
            .map(|o| scalar("head.si") * o + scalar("head.bi"))
            .collect();
        [tape.value(found.score).data().to_vec(), decoded].concat()
    }

    fn assert_close(found: &[f32], expected: &[f32]) {
        let scale = expected.iter().map(|v| v.abs()).fold(0.0, f32::max);
        assert!(found.len() == expected.len() && scale > 0.01);
        let worst = found
            .iter()
            .zip(expected)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(worst < 1e-3 * scale, "{worst} of {scale}");
    }

    #[test]
    fn unfolded_weights_file_computes_the_same() {
        let folder = Folder::new("open");
        let path = folder.path().join("weights.safetensors");
        let dataset = Dataset::open(
            &[pictures(&folder).parse().unwrap()],
            DataOptions::default(),
        );
        let dataset = Arc::new(dataset.unwrap());
        let mut fit = tiny();
        fit.parameters
            .iter_mut()
            .find(|p| p.name() == "head.si")
            .unwrap()
            .value
            .data_mut()[0] = 0.7;
        let mut weights = fit.export(Storage::F32, "tiny", None).unwrap();
        // As a network that was trained on plain pixels.
        let plain = InputNormalization::default();
        let mut conv1 = ["weight", "bias"].map(|p| {
            weights
                .tensor(&format!("backbone.conv1.{p}"))
                .unwrap()
                .clone()
        });
        let [w, b] = &mut conv1;
        InputNormalization::TRAINED.translate(&plain, &mut w.data, &mut b.data);
        let [w, b] = conv1;
        weights.insert("backbone.conv1.weight", w);
        weights.insert("backbone.conv1.bias", b);
        weights.header.input = plain;
        weights.write(&path).unwrap();

        let mut opened = Fit::open(&path).unwrap();
        let expected = outputs(&fit, &dataset);
        assert_close(&outputs(&opened, &dataset), &expected);
        let scale = |fit: &Fit| {
            fit.parameters()[fit.parameters().find("neck.search_cls.bn.scale").unwrap()]
                .value
                .clone()
        };
        let identity = scale(&opened);
        let compute = compute(2).unwrap();
        opened.unfold(&compute, &dataset, 1).unwrap();
        assert_close(&outputs(&opened, &dataset), &expected);
        assert_ne!(scale(&opened), identity);
        // With the data's statistics, training mode sees what evaluation mode does, roughly: a
        // batch is small.
        let before = opened.parameters().clone();
        opened.unfold(&compute, &dataset, 1).unwrap();
        assert!(
            before.state().eq(opened.parameters().state()),
            "once is enough"
        );
        assert_eq!(opened.history(), ["weights tiny, track-cpu trainer 0.1.0"]);
    }

    #[test]
    fn mean_of_two_networks_needs_one_shape() {
        let folder = Folder::new("mean");
        let path = |name: &str| folder.path().join(name);
        let (mut fit, mut expected) = (tiny(), tiny());
        for (i, name) in ["a", "b"].iter().enumerate() {
            for (p, e) in fit
                .parameters
                .iter_mut()
                .zip(expected.parameters.iter_mut())
            {
                p.value.data_mut().fill(1.0 + 4.0 * i as f32);
                e.value.data_mut().fill(3.0);
            }
            fit.begin_averages();
            fit.save(&path(name)).unwrap();
        }
        let mean = Fit::mean(&path("a"), &[path("b")]).unwrap();
        assert!(mean.deployed().state().eq(expected.parameters.state()));
        assert_eq!(mean.history(), ["the mean of 2 networks"]);
        let architecture = Architecture {
            encoder: None,
            ..fit.position.options.architecture
        };
        Fit::around(architecture)
            .unwrap()
            .save(&path("other"))
            .unwrap();
        let error = Fit::mean(&path("a"), &[path("other")])
            .err()
            .unwrap()
            .to_string();
        assert!(
            error.contains("other") && error.contains("a network of the shape of"),
            "{error}"
        );
    }

    #[test]
    fn every_form_of_a_network_opens() {
        let folder = Folder::new("open");
        let fit = tiny();
        let [checkpoint, unfolded, other] = ["a", "b", "c"].map(|name| folder.path().join(name));
        fit.save(&checkpoint).unwrap();
        assert!(
            Fit::open(&checkpoint)
                .unwrap()
                .parameters()
                .state()
                .eq(fit.parameters().state())
        );
        let mut read = Unfolded::read(&checkpoint).unwrap();
        read.source = "a test".into();
        read.write(&unfolded).unwrap();
        let opened = Fit::open(&unfolded).unwrap();
        for (name, tensor) in &read.tensors {
            let id = opened.parameters().find(name).unwrap();
            assert_eq!(opened.parameters()[id].value.data(), tensor.data, "{name}");
        }
        assert_eq!(opened.history(), ["a test"]);
        for (bytes, expected) in [
            (&b"PK\x03\x04"[..], "PyTorch"),
            (b"what", "convert --to trainer"),
            (b"", "found"),
        ] {
            std::fs::write(&other, bytes).unwrap();
            let message = Fit::open(&other).err().unwrap().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
