//! The option `--data WHAT[:SHARE]`.

use crate::error::Error;
use std::path::PathBuf;
use std::str::FromStr;

/// A source of pairs and its share of them.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSpec {
    /// Where the pairs come from.
    pub what: What,
    /// Share of all pairs, in proportion to the other sources' shares.
    pub share: f64,
}

/// Where pairs come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum What {
    /// Annotated frames: a CSV or JSON file, or a folder of sequences.
    Annotated(PathBuf),
    /// Rendered flights.
    Scenes,
    /// Random parts of pictures of a folder or annotation file, as if they were targets.
    Patches(PathBuf),
    /// Things cut out of pictures of a folder or annotation file and pasted into others.
    Paste(PathBuf),
}

impl FromStr for DataSpec {
    type Err = Error;

    fn from_str(text: &str) -> Result<DataSpec, Error> {
        let number = |text: &str| text.parse::<f64>().ok();
        let (what, share) = match text
            .rsplit_once(':')
            .map(|(what, tail)| (what, number(tail)))
        {
            Some((what, Some(share))) => (what, share),
            _ => (text, 1.0),
        };
        if !(share.is_finite() && share > 0.0) {
            return Err(Error::option(
                "--data",
                "a share above 0 behind the last colon",
                share,
            ));
        }
        let what = match what.split_once(':') {
            _ if what == "scenes" => What::Scenes,
            Some(("patches", path)) => What::Patches(path.into()),
            Some(("paste", path)) => What::Paste(path.into()),
            _ if what.is_empty() => {
                let expected = "a CSV or JSON file, a folder, scenes, patches:PATH or paste:PATH, \
                                each with :SHARE";
                return Err(Error::option("--data", expected, text));
            }
            _ => What::Annotated(what.into()),
        };
        Ok(DataSpec { what, share })
    }
}

impl std::fmt::Display for DataSpec {
    /// The text that parses to this value.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.what {
            What::Annotated(path) => write!(f, "{}", path.display())?,
            What::Scenes => write!(f, "scenes")?,
            What::Patches(path) => write!(f, "patches:{}", path.display())?,
            What::Paste(path) => write!(f, "paste:{}", path.display())?,
        }
        write!(f, ":{}", self.share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printed_spec_parses_to_itself() {
        for (text, what, share) in [
            (
                "a/index.csv:0.4",
                What::Annotated("a/index.csv".into()),
                0.4,
            ),
            ("folder", What::Annotated("folder".into()), 1.0),
            ("c:/folder:2", What::Annotated("c:/folder".into()), 2.0),
            ("scenes:0.25", What::Scenes, 0.25),
            ("scenes", What::Scenes, 1.0),
            ("patches:a/b:0.1", What::Patches("a/b".into()), 0.1),
            ("paste:a.csv", What::Paste("a.csv".into()), 1.0),
        ] {
            let spec: DataSpec = text.parse().unwrap();
            assert_eq!(spec, DataSpec { what, share }, "{text}");
            assert_eq!(spec.to_string().parse::<DataSpec>().unwrap(), spec);
        }
        for text in [
            "",
            ":0.4",
            "a.csv:0",
            "a.csv:-1",
            "scenes:inf",
            "scenes:NaN",
        ] {
            assert!(text.parse::<DataSpec>().is_err(), "{text}");
        }
    }
}
