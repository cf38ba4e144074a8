//! The command line of `doctor`.

/// `doctor`.
#[derive(Debug, clap::Args)]
pub struct DoctorArgs {
    /// Print one JSON object in place of text.
    #[arg(long)]
    pub json: bool,
    /// Print the golden file of the self-test that fits the built-in model.
    #[arg(long, hide = true)]
    pub print_golden: bool,
}
