//! `ope export`.

use crate::args::ExportArgs;
use ope::{Error, Results};

/// Writes results in another toolkit's layout.
pub fn run(args: &ExportArgs) -> Result<(), Error> {
    super::check_output(&args.out.join("results"), &[&args.results])?;
    let results = Results::open(&args.results)?;
    let name = match &args.name {
        Some(name) => super::folder_name(name)?.to_owned(),
        None => results.name(),
    };
    let count = ope::export::export(&results, args.to.layout(), args.dataset, &name, &args.out)?;
    eprintln!("{count} sequences in {}", args.out.display());
    Ok(())
}
