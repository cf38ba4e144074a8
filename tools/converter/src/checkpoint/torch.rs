//! The few things of PyTorch that a state dict is made of: storages, tensors, and the functions
//! that rebuild them.

use super::pickle::{Heap, Id, Value};
use crate::error::Refusal;
use half::{bf16, f16};

/// Type of a storage's elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dtype {
    F64,
    F32,
    F16,
    Bf16,
    /// An integer or boolean type: read over, never converted.
    Integer {
        bytes: usize,
    },
}

impl Dtype {
    /// Bytes per element.
    pub fn bytes(self) -> usize {
        match self {
            Dtype::F64 => 8,
            Dtype::F32 => 4,
            Dtype::F16 | Dtype::Bf16 => 2,
            Dtype::Integer { bytes } => bytes,
        }
    }

    /// Element `i` of little-endian `bytes`; `None` for an integer type or beyond the end.
    pub fn element(self, bytes: &[u8], i: usize) -> Option<f64> {
        fn at<const N: usize>(bytes: &[u8], i: usize) -> Option<[u8; N]> {
            bytes.as_chunks::<N>().0.get(i).copied()
        }
        Some(match self {
            Dtype::F64 => f64::from_le_bytes(at(bytes, i)?),
            Dtype::F32 => f32::from_le_bytes(at(bytes, i)?).into(),
            Dtype::F16 => f16::from_le_bytes(at(bytes, i)?).into(),
            Dtype::Bf16 => bf16::from_le_bytes(at(bytes, i)?).into(),
            Dtype::Integer { .. } => return None,
        })
    }
}

/// A global that a pickle may name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Global {
    /// `collections.OrderedDict`.
    OrderedDict,
    /// `torch._utils._rebuild_tensor_v2`.
    RebuildTensor,
    /// `torch._utils._rebuild_parameter`.
    RebuildParameter,
    /// `torch.Size`.
    Size,
    /// `torch.FloatStorage` and its like.
    Storage(Dtype),
}

/// The global of that name, if it is one of the few that are accepted.
pub fn global(module: &str, name: &str) -> Option<Global> {
    let integer = |bytes| Global::Storage(Dtype::Integer { bytes });
    Some(match (module, name) {
        ("collections", "OrderedDict") => Global::OrderedDict,
        ("torch._utils", "_rebuild_tensor_v2") => Global::RebuildTensor,
        ("torch._utils", "_rebuild_parameter") => Global::RebuildParameter,
        ("torch", "Size") => Global::Size,
        ("torch", "DoubleStorage") => Global::Storage(Dtype::F64),
        ("torch", "FloatStorage") => Global::Storage(Dtype::F32),
        ("torch", "HalfStorage") => Global::Storage(Dtype::F16),
        ("torch", "BFloat16Storage") => Global::Storage(Dtype::Bf16),
        ("torch", "LongStorage") => integer(8),
        ("torch", "IntStorage") => integer(4),
        ("torch", "ShortStorage") => integer(2),
        ("torch", "CharStorage" | "ByteStorage" | "BoolStorage") => integer(1),
        _ => return None,
    })
}

/// Whether a global of that qualified name runs code or reads files when it is called.
///
/// Nothing is called here, whatever the name. The list warns a user who may open the checkpoint
/// with Python next.
pub fn runs_code(name: &str) -> bool {
    const MODULES: [&str; 17] = [
        "os",
        "posix",
        "nt",
        "subprocess",
        "sys",
        "runpy",
        "importlib",
        "shutil",
        "socket",
        "pty",
        "code",
        "ctypes",
        "pickle",
        "webbrowser",
        "asyncio",
        "multiprocessing",
        "timeit",
    ];
    const BUILTINS: [&str; 8] = [
        "eval",
        "exec",
        "compile",
        "open",
        "getattr",
        "setattr",
        "__import__",
        "input",
    ];
    let (module, function) = name.split_once('.').unwrap_or((name, ""));
    let builtin = matches!(module, "builtins" | "__builtin__");
    MODULES.contains(&module)
        || builtin && BUILTINS.contains(&function)
        || matches!(name, "torch.load" | "torch.hub.load")
}

/// A run of elements somewhere in the checkpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StorageRef {
    /// Its name within the checkpoint.
    pub key: String,
    /// Type of its elements.
    pub dtype: Dtype,
    /// How many it has.
    pub elements: usize,
}

impl StorageRef {
    /// Its length in bytes; `None` where that does not fit memory.
    pub fn bytes(&self) -> Option<usize> {
        self.elements.checked_mul(self.dtype.bytes())
    }
}

/// A strided view of a storage; every element lies within it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TensorRef {
    /// Where the elements are.
    pub storage: StorageRef,
    /// Index of the first.
    pub offset: usize,
    /// Lengths, outermost first.
    pub shape: Vec<usize>,
    /// Distance in elements between neighbors, for every dimension.
    pub strides: Vec<usize>,
}

impl TensorRef {
    /// Most dimensions accepted.
    const MAX_DIMENSIONS: usize = 8;
    /// Most elements of a tensor that repeats those of its storage (`expand`, stride 0).
    const MAX_REPEATED: usize = 1 << 24;

    /// Checks that every element lies within the storage. There are no more of them than the
    /// storage has, unless a stride of 0 repeats them.
    fn new(
        storage: StorageRef,
        offset: usize,
        shape: Vec<usize>,
        strides: Vec<usize>,
    ) -> Result<TensorRef, Refusal> {
        if shape.len() > Self::MAX_DIMENSIONS || strides.len() != shape.len() {
            let expected = format!(
                "as many strides as dimensions, at most {}",
                Self::MAX_DIMENSIONS
            );
            return Err(Refusal::new(
                "tensor",
                expected,
                format!("{} and {}", strides.len(), shape.len()),
            ));
        }
        let available = storage.elements;
        let describe = || format!("offset {offset}, shape {shape:?}, strides {strides:?}");
        let outside = || {
            Refusal::new(
                "tensor",
                format!("elements within its storage of {available}"),
                describe(),
            )
        };
        let elements = shape
            .iter()
            .try_fold(1_usize, |product, &n| product.checked_mul(n))
            .ok_or_else(outside)?;
        let distinct: usize = shape
            .iter()
            .zip(&strides)
            .filter(|(_, stride)| **stride > 0)
            .fold(1, |product, (n, _)| product.saturating_mul(*n));
        if distinct > available || elements > available.max(Self::MAX_REPEATED) {
            return Err(outside());
        }
        if elements > 0 {
            let last = shape
                .iter()
                .zip(&strides)
                .try_fold(offset, |last, (&n, &stride)| {
                    (n - 1)
                        .checked_mul(stride)
                        .and_then(|distance| last.checked_add(distance))
                });
            if last.is_none_or(|last| last >= available) {
                return Err(outside());
            }
        }
        Ok(TensorRef {
            storage,
            offset,
            shape,
            strides,
        })
    }

    /// The whole of a storage, row-major.
    ///
    /// # Errors
    /// If the storage does not have as many elements as the shape.
    pub fn whole(storage: StorageRef, shape: Vec<usize>) -> Result<TensorRef, Refusal> {
        let strides = (0..shape.len())
            .map(|i| shape[i + 1..].iter().product())
            .collect();
        TensorRef::new(storage, 0, shape, strides)
    }

    /// Every element in row-major order, from the storage's bytes; `None` for an integer type.
    pub fn elements(&self, bytes: &[u8]) -> Option<Vec<f64>> {
        if self.shape.contains(&0) {
            return Some(Vec::new());
        }
        let mut indices = vec![self.offset];
        for (&n, &stride) in self.shape.iter().zip(&self.strides) {
            indices = indices
                .iter()
                .flat_map(|&start| (0..n).map(move |i| start + i * stride))
                .collect();
        }
        indices
            .iter()
            .map(|&i| self.storage.dtype.element(bytes, i))
            .collect()
    }
}

/// Most arguments of a call, and parts of a persistent id, that are read.
const MAX_ITEMS: usize = 8;
/// Longest key of a storage: every tensor carries a copy.
const MAX_KEY: usize = 64;

/// The storage that a persistent id stands for: `("storage", type, key, location, elements[,
/// None])`.
pub fn storage(heap: &Heap, id: Id) -> Result<StorageRef, Refusal> {
    let wrong = |found: &Value| Refusal::new("persistent id", "one of a storage", found.kind());
    let items = match heap.get(id) {
        Value::Tuple(items) if items.len() <= MAX_ITEMS => items,
        other => return Err(wrong(other)),
    };
    let items: Vec<&Value> = items.iter().map(|&item| heap.get(item)).collect();
    if let [Value::Str(tag), Value::Opaque(name), ..] = &items[..]
        && tag == "storage"
    {
        let expected = "elements of a floating-point, integer or bool type";
        return Err(Refusal::new("storage", expected, format!("`{name}`")));
    }
    let [
        Value::Str(tag),
        Value::Global(Global::Storage(dtype)),
        Value::Str(key),
        Value::Str(_),
        elements,
        view @ ..,
    ] = &items[..]
    else {
        return Err(wrong(heap.get(id)));
    };
    if tag != "storage" {
        return Err(Refusal::new(
            "persistent id",
            "one of a storage",
            format!("{tag:?}"),
        ));
    }
    if !matches!(view, [] | [Value::None]) {
        return Err(Refusal::new(
            format!("storage {key:?}"),
            "no view of another storage",
            "one",
        ));
    }
    if key.len() > MAX_KEY {
        return Err(Refusal::new(
            "storage",
            format!("a key of at most {MAX_KEY} bytes"),
            key.len(),
        ));
    }
    let storage = StorageRef {
        key: key.clone(),
        dtype: *dtype,
        elements: size(elements)?,
    };
    match storage.bytes() {
        Some(_) => Ok(storage),
        None => Err(Refusal::new(
            format!("storage {key:?}"),
            "a length that fits memory",
            storage.elements,
        )),
    }
}

/// What calling `global` with `arguments` makes.
pub fn call(heap: &Heap, global: &Global, arguments: &[Id]) -> Result<Value, Refusal> {
    if arguments.len() > MAX_ITEMS {
        let expected = format!("at most {MAX_ITEMS} arguments");
        return Err(Refusal::new(
            format!("{global:?}"),
            expected,
            arguments.len(),
        ));
    }
    let values: Vec<&Value> = arguments.iter().map(|&id| heap.get(id)).collect();
    let wrong = |expected: &str| {
        let kinds: Vec<_> = values.iter().map(|value| value.kind()).collect();
        Err(Refusal::new(
            format!("{global:?}"),
            expected,
            format!("({})", kinds.join(", ")),
        ))
    };
    match (global, &values[..]) {
        (Global::OrderedDict, []) => Ok(Value::Dict(Vec::new())),
        (
            Global::RebuildTensor,
            [
                Value::Storage(storage),
                offset,
                Value::Tuple(shape),
                Value::Tuple(strides),
                rest @ ..,
            ],
        ) if (2..=3).contains(&rest.len()) => {
            let sizes = |ids: &[Id]| {
                ids.iter()
                    .map(|&id| size(heap.get(id)))
                    .collect::<Result<Vec<_>, _>>()
            };
            let tensor = TensorRef::new(
                (**storage).clone(),
                size(offset)?,
                sizes(shape)?,
                sizes(strides)?,
            )?;
            Ok(Value::Tensor(Box::new(tensor)))
        }
        (Global::RebuildTensor, _) => {
            wrong("(storage, offset, shape, strides, requires_grad, hooks)")
        }
        (Global::RebuildParameter, [Value::Tensor(tensor), _, _]) => {
            Ok(Value::Tensor(tensor.clone()))
        }
        (Global::RebuildParameter, _) => wrong("(tensor, requires_grad, hooks)"),
        (Global::Size, [Value::Tuple(sizes)]) if sizes.len() <= TensorRef::MAX_DIMENSIONS => {
            Ok(Value::Tuple(sizes.clone()))
        }
        _ => wrong("no call, or one with other arguments"),
    }
}

/// A value as an offset, length or stride.
fn size(value: &Value) -> Result<usize, Refusal> {
    match value {
        Value::Int(value) => usize::try_from(*value).ok(),
        _ => None,
    }
    .ok_or_else(|| Refusal::new("size", "a non-negative integer", value.kind()))
}
