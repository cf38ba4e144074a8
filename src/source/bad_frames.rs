//! What a run does about a frame that cannot be read.

use super::SourceError;

/// What a run does about a frame that cannot be read, while its input goes on behind it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnBadFrame {
    /// The run ends with an error.
    Stop,
    /// The frame is left out of the results.
    Skip,
    /// The box of the frame before is reported again.
    #[default]
    Hold,
}

impl OnBadFrame {
    /// Every policy with its name on the command line.
    pub const NAMES: [(&'static str, OnBadFrame); 3] = [
        ("stop", OnBadFrame::Stop),
        ("skip", OnBadFrame::Skip),
        ("hold", OnBadFrame::Hold),
    ];

    /// The policy of this name, if there is one.
    pub fn from_name(name: &str) -> Option<OnBadFrame> {
        let found = Self::NAMES.iter().find(|(known, _)| *known == name);
        found.map(|&(_, policy)| policy)
    }
}

/// Counts the frames of a run that could not be read, and decides what each leads to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BadFrames {
    policy: OnBadFrame,
    count: usize,
}

impl BadFrames {
    /// None so far.
    pub fn new(policy: OnBadFrame) -> BadFrames {
        BadFrames { policy, count: 0 }
    }

    /// Counts a bad frame; the caller then holds or skips it, as the policy says.
    ///
    /// # Errors
    /// Gives the error back if it ends the run: if the policy is to stop, or if no frame can
    /// follow.
    pub fn pass(&mut self, error: SourceError) -> Result<BadFrame, SourceError> {
        if self.policy == OnBadFrame::Stop || error.ends_input() {
            return Err(error);
        }
        self.count += 1;
        Ok(BadFrame {
            is_held: self.policy == OnBadFrame::Hold,
            error,
        })
    }

    /// How many frames were passed over.
    pub fn count(&self) -> usize {
        self.count
    }
}

/// A frame that could not be read and did not end the run.
#[derive(Debug)]
pub struct BadFrame {
    /// Whether the box of the frame before stands for it; otherwise it is left out.
    pub is_held: bool,
    /// Why it could not be read.
    pub error: SourceError,
}

impl std::fmt::Display for BadFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let consequence = if self.is_held {
            "its box is held"
        } else {
            "it is skipped"
        };
        write!(f, "{}: {consequence}", self.error)
    }
}

impl SourceError {
    /// Whether no frame can follow this error: a stream is out of step, while a folder has more
    /// files.
    pub fn ends_input(&self) -> bool {
        match self {
            SourceError::Io { .. } | SourceError::Decode { .. } => false,
            SourceError::Empty { .. }
            | SourceError::Program { .. }
            | SourceError::Format { .. } => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_decide_about_bad_files_and_broken_streams() {
        let file = || SourceError::Decode {
            path: "2.jpg".into(),
            reason: "cut short".into(),
        };
        let stream = || SourceError::Format {
            input: "-".into(),
            reason: "cut short".into(),
        };
        for (name, policy) in OnBadFrame::NAMES {
            let mut frames = BadFrames::new(OnBadFrame::from_name(name).unwrap());

            let passed = frames.pass(file()).map(|bad| bad.is_held).ok();
            let ended = frames.pass(stream()).is_err();

            let expected = match policy {
                OnBadFrame::Stop => None,
                OnBadFrame::Skip => Some(false),
                OnBadFrame::Hold => Some(true),
            };
            assert_eq!(passed, expected, "{name}");
            assert_eq!(frames.count(), usize::from(expected.is_some()), "{name}");
            assert!(ended, "{name}");
        }
        assert_eq!(OnBadFrame::from_name("ignore"), None);
    }
}
