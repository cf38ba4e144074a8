//! One folder of results from those of several shards.

use crate::error::Error;
use crate::results::Results;
use std::path::Path;

/// Copies the results in `parts` to `into` and returns the number of sequences there.
///
/// # Errors
/// If a file cannot be used, or two folders have different boxes of one sequence or are of
/// different trackers.
pub fn merge(parts: &[impl AsRef<Path>], into: &Path) -> Result<usize, Error> {
    let merged = Results::create(into)?;
    for part in parts {
        let part = Results::open(part.as_ref())?;
        if let Some(origin) = part.origin()? {
            merged.reserve(&origin)?;
        }
        for name in part.names()? {
            let Some(boxes) = part.boxes(&name)? else {
                continue;
            };
            match merged.boxes(&name)? {
                Some(there) if there == boxes => {}
                Some(_) => {
                    let found = format!("others in {}", into.display());
                    return Err(Error::content(
                        part.folder(),
                        format!("the same boxes of {name}"),
                        found,
                    ));
                }
                None => merged.write(&name, &boxes, &part.times(&name)?.unwrap_or_default())?,
            }
        }
    }
    Ok(merged.names()?.len())
}
