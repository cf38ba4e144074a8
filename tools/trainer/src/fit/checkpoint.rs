//! A training run on disk: one safetensors file with parameters, optimizer state, averages, and the
//! position in the data.

use super::options::FitOptions;
use crate::data::DataOptions;
use crate::error::Error;
use autodiff::Tensor;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;

/// Progress and options of a run, without its tensors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Position {
    /// Version of this file's layout.
    pub format: u32,
    /// How the network is trained.
    pub options: FitOptions,
    /// The data as the user named them.
    pub data: Vec<String>,
    /// How pairs are made of them.
    pub data_options: DataOptions,
    /// Steps done; also the number of the next batch.
    pub step: u64,
    /// Seconds of training.
    pub seconds: f64,
    /// Whether the run is over, with batch statistics re-estimated.
    pub finished: bool,
    /// The best validation so far and its step.
    pub best: Option<(f64, u64)>,
    /// What was done to the parameters before this run, one sentence per run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub history: Vec<String>,
}

/// A run's tensors by kind and name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Every parameter and statistic.
    pub parameters: Vec<(String, Tensor)>,
    /// State of the optimizer.
    pub optimizer: Vec<(String, Tensor)>,
    /// Running averages of the parameters, if the run keeps them.
    pub averages: Vec<(String, Tensor)>,
}

const FORMAT: u32 = 1;
const KEY: &str = "trainer";

/// Largest checkpoint that is read, in bytes.
const MAX_BYTES: u64 = 4 << 30;

impl Position {
    /// A run that has not begun.
    pub fn start(options: FitOptions, data: Vec<String>, data_options: DataOptions) -> Position {
        Position {
            format: FORMAT,
            options,
            data,
            data_options,
            step: 0,
            seconds: 0.0,
            finished: false,
            best: None,
            history: Vec::new(),
        }
    }
}

/// Writes a checkpoint under a temporary name and renames it, so that an interruption leaves no
/// half file.
///
/// # Errors
/// If the file cannot be written.
pub fn save(path: &Path, position: &Position, state: &State) -> Result<(), Error> {
    let text = serde_json::to_string(position)
        .map_err(|error| Error::file(path, "a position that can be written", error))?;
    let metadata = HashMap::from([(KEY.to_owned(), text)]);
    let kinds = [
        ("parameter", &state.parameters),
        ("optimizer", &state.optimizer),
        ("average", &state.averages),
    ];
    let mut views = Vec::new();
    for (kind, tensors) in kinds {
        for (name, tensor) in tensors {
            let bytes = bytemuck::cast_slice(tensor.data());
            let view = TensorView::new(Dtype::F32, tensor.shape().to_vec(), bytes)
                .map_err(|error| Error::file(path, "a tensor that can be written", error))?;
            views.push((format!("{kind}.{name}"), view));
        }
    }
    let bytes = safetensors::serialize(views, Some(metadata))
        .map_err(|error| Error::file(path, "tensors that can be written", error))?;
    write_atomically(path, &bytes)
}

/// Writes a file under a temporary name beside `path`, then renames it.
///
/// # Errors
/// If the file cannot be written.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), Error> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = path.with_file_name(name);
    let written = File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    });
    if written.is_err() {
        let _ = fs::remove_file(&temporary); // the first error is the one worth reporting
    }
    written.map_err(Error::io(path))
}

/// What a safetensors file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A run.
    Checkpoint,
    /// A network's parameters, normalizations apart.
    Unfolded,
    /// A weights file, normalizations folded in.
    Weights,
}

/// Detects the kind of a file.
///
/// # Errors
/// If it cannot be read or has none of these formats.
pub fn form(path: &Path) -> Result<Form, Error> {
    let expected = "a training checkpoint, a weights file, or what `convert --to trainer` writes";
    let bytes = read(path)?;
    // A safetensors file begins with the length of its header, whose first byte may be anything.
    let begins = |signature: &[u8]| bytes.starts_with(signature) && bytes.get(8) != Some(&b'{');
    if begins(b"PK") || begins(&[0x80]) {
        return Err(Error::file(path, expected, "a PyTorch checkpoint"));
    }
    let (_, header) =
        SafeTensors::read_metadata(&bytes).map_err(|error| Error::file(path, expected, error))?;
    let has = |key: &str| {
        header
            .metadata()
            .as_ref()
            .is_some_and(|metadata| metadata.contains_key(key))
    };
    let forms = [
        (KEY, Form::Checkpoint),
        ("parameters", Form::Unfolded),
        ("track-cpu", Form::Weights),
    ];
    let found = forms.into_iter().find(|(key, _)| has(key));
    found
        .map(|(_, form)| form)
        .ok_or_else(|| Error::file(path, expected, "metadata of none of them"))
}

/// Reads a file within the bound.
fn read(path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(Error::io(path))?;
    file.take(MAX_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(Error::io(path))?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(Error::file(
            path,
            format!("at most {MAX_BYTES} bytes"),
            "more",
        ));
    }
    Ok(bytes)
}

/// Reads a checkpoint.
///
/// # Errors
/// If the file cannot be read or is not a checkpoint of this version.
pub fn load(path: &Path) -> Result<(Position, State), Error> {
    let bytes = read(path)?;
    let wrong =
        |found: &dyn ToString| Error::file(path, "a training checkpoint", found.to_string());
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|error| wrong(&error))?;
    let text = header
        .metadata()
        .as_ref()
        .and_then(|metadata| metadata.get(KEY));
    let text = text.ok_or_else(|| wrong(&"a file without the trainer's metadata"))?;
    let position: Position = serde_json::from_str(text).map_err(|error| wrong(&error))?;
    if position.format != FORMAT {
        return Err(wrong(&format!(
            "format {}, expected {FORMAT}",
            position.format
        )));
    }
    position.options.check()?;
    let tensors = SafeTensors::deserialize(&bytes).map_err(|error| wrong(&error))?;
    let mut state = State::default();
    for (name, view) in tensors.tensors() {
        if view.dtype() != Dtype::F32 {
            return Err(wrong(&format!(
                "tensor {name:?} of type {:?}, expected F32",
                view.dtype()
            )));
        }
        let values = view
            .data()
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let tensor = Tensor::new(view.shape(), values.collect());
        let list = match name.split_once('.') {
            Some(("parameter", rest)) => (&mut state.parameters, rest),
            // Older checkpoints spell it with an s.
            Some(("optimizer" | "optimiser", rest)) => (&mut state.optimizer, rest),
            Some(("average", rest)) => (&mut state.averages, rest),
            _ => return Err(wrong(&format!("a tensor named {name:?}"))),
        };
        list.0.push((list.1.to_owned(), tensor));
    }
    Ok((position, state))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    fn example() -> (Position, State) {
        let mut position = Position::start(
            FitOptions::paper(),
            vec!["scenes:1".into()],
            DataOptions::default(),
        );
        (position.step, position.seconds, position.best) = (7, 0.1, Some((0.25, 5)));
        let tensor = |v: f32| Tensor::new(&[1, 2], vec![v, -0.0]);
        let state = State {
            parameters: vec![
                ("a.weight".into(), tensor(1.0)),
                ("b".into(), Tensor::scalar(f32::MIN_POSITIVE)),
            ],
            optimizer: vec![("mean.a.weight".into(), tensor(2.0))],
            averages: vec![("a.weight".into(), tensor(3.0))],
        };
        (position, state)
    }

    #[test]
    fn saved_checkpoint_loads_with_the_same_bits() {
        let folder = Folder::new("checkpoint");
        let path = folder.path().join("c.safetensors");
        let (position, state) = example();
        save(&path, &position, &state).unwrap();
        save(&path, &position, &state).unwrap(); // over an old one
        let (found, mut loaded) = load(&path).unwrap();
        loaded.parameters.sort_by(|a, b| a.0.cmp(&b.0));
        assert_eq!((found, loaded), (position, state));
        assert_eq!(
            fs::read_dir(folder.path()).unwrap().count(),
            1,
            "nothing is left beside it"
        );
    }

    #[test]
    fn files_that_are_no_checkpoint_are_refused() {
        let folder = Folder::new("checkpoint");
        let path = folder.path().join("c.safetensors");
        let (position, state) = example();
        save(&path, &position, &state).unwrap();
        let bytes = fs::read(&path).unwrap();
        for (bytes, expected) in [
            (&bytes[..bytes.len() / 2], "a training checkpoint"),
            (&b"nonsense nonsense"[..], "a training checkpoint"),
            (&[][..], "a training checkpoint"),
        ] {
            fs::write(&path, bytes).unwrap();
            let message = load(&path).unwrap_err().to_string();
            assert!(
                message.contains(expected) && message.contains("c.safetensors"),
                "{message}"
            );
        }
        let weights = weights_format::Weights::random(super::super::options::standard(0.9), 1);
        weights.write(&path).unwrap();
        assert!(
            load(&path)
                .unwrap_err()
                .to_string()
                .contains("without the trainer's metadata")
        );
        assert!(load(&folder.path().join("none")).is_err());
    }
}
