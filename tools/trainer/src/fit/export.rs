//! Export of the deployed network with its provenance.

use super::{Fit, Position};
use crate::data::spec::DataSpec;
use crate::error::{Error, brief};
use crate::validate::Report;
use program::printable;
use weights_format::{Provenance, Storage, Weights};

impl Fit {
    /// Exports the deployed network with its provenance: data and their shares, steps, pairs,
    /// hours, seed, commit, options, history, and `figures` of validation.
    ///
    /// # Errors
    /// If a value does not fit the storage or is not finite.
    pub fn export(
        &self,
        storage: Storage,
        name: &str,
        figures: Option<&Report>,
    ) -> Result<Weights, Error> {
        let Position {
            options,
            data,
            data_options,
            step,
            seconds,
            history,
            ..
        } = &self.position;
        // With every share, also those that were left out as 1.
        let specs = data.iter().map(|text| {
            text.parse::<DataSpec>()
                .map_or(text.clone(), |s| s.to_string())
        });
        let mut notes = vec![
            ("data", specs.collect::<Vec<_>>().join(" ")),
            ("steps", step.to_string()),
            ("pairs", (step * options.batch as u64).to_string()),
            ("hours", format!("{:.2}", seconds / 3600.0)),
            ("seed", data_options.seed.to_string()),
            ("commit", commit()),
            (
                "options",
                serde_json::to_string(options).unwrap_or_default(),
            ),
        ];
        if !history.is_empty() {
            notes.push(("before", history.join("; ")));
        }
        notes.extend(figures.map(|report| ("validation", report.to_string())));
        let provenance = Provenance {
            name: brief(name),
            source: format!("track-cpu trainer {}", env!("CARGO_PKG_VERSION")),
            notes: notes
                .into_iter()
                .map(|(key, text)| (key.to_owned(), printable(&text)))
                .collect(),
        };
        let weights = self.network.export(&self.deployed(), storage, provenance);
        weights.check()?;
        Ok(weights)
    }
}

/// Commit of the source, if that lies in a repository.
fn commit() -> String {
    let git = std::process::Command::new("git")
        .args([
            "-C",
            env!("CARGO_MANIFEST_DIR"),
            "rev-parse",
            "--short",
            "HEAD",
        ])
        .output();
    let text = git.ok().filter(|output| output.status.success());
    let text = text.and_then(|output| String::from_utf8(output.stdout).ok());
    text.map_or_else(|| "unknown".into(), |text| text.trim().to_owned())
}
