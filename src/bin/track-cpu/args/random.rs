//! Networks of random weights, where numbers do not matter.

use clap::ValueEnum;
use track_cpu::ModelError;
use weights_format::{Architecture, Encoder, Weights, Widths};

/// Which network, where a random one will do.
#[derive(Debug, clap::Args)]
pub struct RandomArgs {
    /// A random network: half, full, P0 to P90 (percent pruned), C1,C2,C3,C4,C5,N, or all 13
    /// widths.
    #[arg(long, value_name = "WIDTHS", value_parser = widths, conflicts_with = "model")]
    widths: Option<Widths>,
    /// Identity-related encoder of a random network.
    #[arg(
        long,
        value_enum,
        default_value_t = EncoderChoice::None,
        requires = "widths",
        conflicts_with = "model"
    )]
    encoder: EncoderChoice,
}

/// The encoder of a random network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EncoderChoice {
    /// No encoder: the P-SiamFC++ family.
    None,
    /// One 3x3 convolution, the standard.
    #[value(name = "3x3")]
    Three,
    /// One 1x1 convolution.
    #[value(name = "1x1")]
    One,
}

impl RandomArgs {
    /// The random network asked for, if one was.
    pub fn architecture(&self) -> Result<Option<Architecture>, ModelError> {
        let Some(widths) = self.widths else {
            return Ok(None);
        };
        let standard = Encoder::standard(widths.backbone[4]);
        let encoder = match self.encoder {
            EncoderChoice::None => None,
            EncoderChoice::Three => Some(standard),
            EncoderChoice::One => Some(Encoder {
                kernel: 1,
                ..standard
            }),
        };
        let architecture = Architecture::new(widths, encoder);
        architecture.check()?;
        Ok(Some(architecture))
    }

    /// Random weights, if they were asked for.
    pub fn weights(&self) -> Result<Option<Weights>, ModelError> {
        let architecture = self.architecture()?;
        Ok(architecture.map(|architecture| Weights::random(architecture, 1)))
    }
}

fn widths(text: &str) -> Result<Widths, String> {
    let pruned = text
        .strip_prefix('P')
        .and_then(|percent| percent.parse::<u8>().ok());
    let list: Option<Vec<usize>> = text.split(',').map(|number| number.parse().ok()).collect();
    let widths = match (text, pruned, list.as_deref()) {
        ("half", ..) => Widths::pruned(0.5),
        ("full", ..) => Widths::FULL,
        (_, Some(percent @ 0..=90), _) => Widths::pruned(f64::from(percent) / 100.0),
        (.., Some(&[c1, c2, c3, c4, c5, n])) => Widths::uniform([c1, c2, c3, c4, c5], n),
        (.., Some(&[c1, c2, c3, c4, c5, neck_cls, neck_reg, a, b, c, d, e, f])) => Widths {
            backbone: [c1, c2, c3, c4, c5],
            neck_cls,
            neck_reg,
            head_cls: [a, b, c],
            head_reg: [d, e, f],
        },
        _ => return Err("expected half, full, P0 to P90, 6 numbers or 13 numbers".into()),
    };
    Architecture::new(widths, None)
        .check()
        .map_err(|error| error.to_string())?;
    Ok(widths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_in_every_form_are_parsed() {
        assert_eq!(widths("half"), Ok(Widths::pruned(0.5)));
        assert_eq!(widths("P50"), Ok(Widths::pruned(0.5)));
        assert_eq!(widths("P0"), Ok(Widths::FULL));
        assert_eq!(widths("full"), Ok(Widths::FULL));
        assert_eq!(widths("48,128,192,192,128,128"), Ok(Widths::pruned(0.5)));
        let paper = widths("76,224,337,334,256,256,256,230,138,224,227,145,224").unwrap();
        assert_eq!(Architecture::new(paper, None).parameters(), 7_489_986);
    }

    #[test]
    fn wrong_widths_are_refused_with_what_is_expected() {
        for (text, part) in [
            ("P100", "P90"),
            ("P-1", "P90"),
            ("quarter", "half"),
            ("", "half"),
            ("1,2,3", "13 numbers"),
            ("0,1,1,1,1,1", "widths[0] is 0"),
            ("1,1,1,1,1,999999", "999999"),
        ] {
            let message = widths(text).unwrap_err();
            assert!(message.contains(part), "{text}: {message}");
        }
    }
}
