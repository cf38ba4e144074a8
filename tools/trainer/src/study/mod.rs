//! Studies: training runs that differ in one thing, with a table and a plot of their results.
//!
//! Each run has its own folder and writes `result.json` at its end. A restarted study skips
//! finished runs and continues the interrupted one.

mod table;
#[cfg(test)]
mod tests;
mod variants;

pub use table::{json, markdown, svg};
pub use variants::{VARIANTS, ablation, sweep};

use crate::data::{DataOptions, Dataset};
use crate::error::Error;
use crate::fit::{Fit, FitOptions, RunOptions, write_atomically};
use crate::validate::Report;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// One of a study's runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Group of runs that differ in the seed only: a row of the table.
    pub group: String,
    /// How it is trained.
    pub options: FitOptions,
    /// How its pairs are made.
    pub data_options: DataOptions,
    /// File with its initial parameters; random ones if there is none.
    pub start: Option<PathBuf>,
}

/// Several runs on the same data.
#[derive(Clone, Debug)]
pub struct Study {
    /// Heading of the table's first column.
    pub title: String,
    /// The data as the user named them.
    pub data: Vec<String>,
    /// The runs, in this order.
    pub variants: Vec<Variant>,
}

/// Result of one run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Outcome {
    /// The variant's group.
    pub group: String,
    /// How it was trained.
    pub options: FitOptions,
    /// How its pairs were made.
    pub data_options: DataOptions,
    /// The data as the user named them.
    pub data: Vec<String>,
    /// Parameters of the deployed network.
    pub parameters: usize,
    /// Multiply-accumulates per search crop.
    pub macs: u64,
    /// Steps done.
    pub steps: u64,
    /// Seconds of training.
    pub seconds: f64,
    /// Accuracy.
    pub report: Report,
}

impl Variant {
    /// Its folder's name.
    pub fn name(&self) -> String {
        format!("{}-seed{}", self.group, self.options.seed)
    }
}

impl Study {
    /// Runs what is unfinished, and writes `table.md`, `table.json` and `plot.svg` after each run.
    /// Returns all results.
    ///
    /// # Errors
    /// If a run fails, or a folder holds a run of other options.
    pub fn run(&self, run: &RunOptions) -> Result<Vec<Outcome>, Error> {
        if run.validation.is_empty() {
            return Err(Error::option(
                "--validate",
                "sequences or flights to compare by",
                "none",
            ));
        }
        std::fs::create_dir_all(&run.out).map_err(Error::io(&run.out))?;
        let mut open: Option<Arc<Dataset>> = None;
        let mut outcomes = Vec::with_capacity(self.variants.len());
        for (i, variant) in self.variants.iter().enumerate() {
            let folder = run.out.join(variant.name());
            let path = folder.join("result.json");
            let outcome = match self.done(variant, &path)? {
                Some(outcome) => outcome,
                None => {
                    eprintln!(
                        "run {} of {}: {}",
                        i + 1,
                        self.variants.len(),
                        variant.name()
                    );
                    let dataset = match open.take().filter(|d| *d.options() == variant.data_options)
                    {
                        Some(dataset) => dataset,
                        None => Arc::new(self.dataset(variant)?),
                    };
                    open = Some(dataset.clone());
                    let outcome = self.train(
                        variant,
                        dataset,
                        &RunOptions {
                            out: folder,
                            ..run.clone()
                        },
                    )?;
                    write(
                        &path,
                        &serde_json::to_string_pretty(&outcome).unwrap_or_default(),
                    )?;
                    outcome
                }
            };
            outcomes.push(outcome);
            write(&run.out.join("table.md"), &markdown(&self.title, &outcomes))?;
            write(&run.out.join("table.json"), &json(&self.title, &outcomes))?;
            write(&run.out.join("plot.svg"), &svg(&self.title, &outcomes))?;
        }
        Ok(outcomes)
    }

    fn dataset(&self, variant: &Variant) -> Result<Dataset, Error> {
        let specs: Result<Vec<_>, _> = self.data.iter().map(|text| text.parse()).collect();
        Dataset::open(&specs?, variant.data_options.clone())
    }

    /// Result of a finished run.
    fn done(&self, variant: &Variant, path: &Path) -> Result<Option<Outcome>, Error> {
        if !path.exists() {
            return Ok(None);
        }
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let outcome: Outcome = serde_json::from_slice(&bytes)
            .map_err(|error| Error::file(path, "the result of a run", error))?;
        let Outcome {
            options,
            data_options,
            data,
            ..
        } = &outcome;
        self.same(variant, path, options, data_options, data)?;
        Ok(Some(outcome))
    }

    /// Refuses a run of other options or data.
    fn same(
        &self,
        variant: &Variant,
        path: &Path,
        options: &FitOptions,
        data_options: &DataOptions,
        data: &[String],
    ) -> Result<(), Error> {
        let differs = match () {
            () if *options != variant.options => "other training options",
            () if *data_options != variant.data_options => "other options of the data",
            () if *data != self.data => "other data",
            () => return Ok(()),
        };
        Err(Error::file(
            path,
            "a run of this study (or choose another --out)",
            differs,
        ))
    }

    /// Starts or continues a run.
    fn train(
        &self,
        variant: &Variant,
        dataset: Arc<Dataset>,
        run: &RunOptions,
    ) -> Result<Outcome, Error> {
        let checkpoint = run.out.join("checkpoint.safetensors");
        let mut fit = if checkpoint.exists() {
            let fit = Fit::resume(&checkpoint)?;
            let position = fit.position();
            self.same(
                variant,
                &checkpoint,
                &position.options,
                &position.data_options,
                &position.data,
            )?;
            fit
        } else {
            let (options, data_options) = (variant.options.clone(), variant.data_options.clone());
            let mut fit = Fit::start(options, self.data.clone(), data_options)?;
            if let Some(start) = &variant.start {
                let fresh = fit.take_over(&Fit::open(start)?);
                if !fresh.is_empty() {
                    eprintln!(
                        "initialized, since {} lacks them: {}",
                        start.display(),
                        fresh.join(", ")
                    );
                }
            }
            fit
        };
        let report = fit.run(dataset, run)?;
        let architecture = fit.network().architecture();
        Ok(Outcome {
            group: variant.group.clone(),
            options: variant.options.clone(),
            data_options: variant.data_options.clone(),
            data: self.data.clone(),
            parameters: architecture.parameters(),
            macs: architecture.macs_search(),
            steps: fit.position().step,
            seconds: fit.position().seconds,
            report: report.unwrap_or_default(),
        })
    }
}

fn write(path: &Path, text: &str) -> Result<(), Error> {
    write_atomically(path, text.as_bytes())
}
