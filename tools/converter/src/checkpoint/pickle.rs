//! Pickle read as data: a stack machine that builds plain values, knows a handful of names, and
//! calls nothing.
//!
//! Values live in one [`Heap`] and refer to each other by index. Nothing that reads them recurses,
//! so neither cycles nor deep nesting can do harm. Every opcode adds at most one value of bounded
//! size, or moves values that others added, so time and memory are proportional to the input's
//! length.
//!
//! A checkpoint may carry other things beside its tensors, such as a run's arguments. An object of
//! an unknown class stays [`Value::Opaque`]: a name without content. No class is looked up, nothing
//! is called. A pickle that calls something that runs code, such as `os.system`, is refused all the
//! same, because its other readers would run it.
//!
//! Source: Python's `pickletools`, protocols 0 to 5 as far as `torch.save` uses them.

use super::torch::{self, Global, StorageRef, TensorRef};
use crate::error::{Refusal, brief};
use std::collections::HashMap;

/// Longest pickle accepted; that of a checkpoint with optimizer state has about a hundred
/// kilobytes.
pub const MAX_BYTES: usize = 2 << 20;

/// Index of a value in a [`Heap`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Id(u32);

/// One value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    None,
    Bool(bool),
    Int(i128),
    /// A float. No tensor needs its value, so it is not kept.
    Float,
    Str(String),
    Tuple(Vec<Id>),
    List(Vec<Id>),
    /// `dict` and `OrderedDict`, in the order of insertion; a key may occur twice.
    Dict(Vec<(Id, Id)>),
    Global(Global),
    /// An unknown class or function, or an object made by one: its qualified name.
    Opaque(String),
    Storage(Box<StorageRef>),
    Tensor(Box<TensorRef>),
}

impl Value {
    /// What kind of value it is, for messages.
    pub fn kind(&self) -> String {
        match self {
            Value::None => "None".into(),
            Value::Bool(value) => format!("{value}"),
            Value::Int(value) => format!("{value}"),
            Value::Float => "a float".into(),
            Value::Str(text) => format!("{:?}", text.chars().take(80).collect::<String>()),
            Value::Tuple(items) => format!("a tuple of {}", items.len()),
            Value::List(items) => format!("a list of {}", items.len()),
            Value::Dict(items) => format!("a dict of {}", items.len()),
            Value::Global(global) => format!("{global:?}"),
            Value::Opaque(name) => format!("an object of `{name}`"),
            Value::Storage(_) => "a storage".into(),
            Value::Tensor(tensor) => format!("a tensor of shape {:?}", tensor.shape),
        }
    }
}

/// All values of a pickle.
#[derive(Debug, Default)]
pub struct Heap {
    values: Vec<Value>,
}

impl Heap {
    /// The value of an id of this heap.
    pub fn get(&self, id: Id) -> &Value {
        &self.values[id.0 as usize]
    }

    /// Every value, in no useful order.
    pub fn values(&self) -> impl Iterator<Item = &Value> {
        self.values.iter()
    }

    fn add(&mut self, value: Value) -> Id {
        self.values.push(value);
        Id((self.values.len() - 1) as u32)
    }
}

/// What a pickle holds.
#[derive(Debug)]
pub struct Pickle {
    /// All values.
    pub heap: Heap,
    /// The one that `pickle.load` would return.
    pub root: Id,
    /// How many bytes the pickle has; more may follow it.
    pub length: usize,
}

/// Reads the pickle at the start of `bytes`.
///
/// # Errors
/// Names the byte and the opcode or global that is not accepted.
pub fn read(bytes: &[u8]) -> Result<Pickle, Refusal> {
    let mut machine = Machine {
        input: &bytes[..bytes.len().min(MAX_BYTES)],
        at: 0,
        opcode_at: 0,
        heap: Heap::default(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: HashMap::new(),
    };
    let root = machine.run()?;
    Ok(Pickle {
        heap: machine.heap,
        root,
        length: machine.at,
    })
}

/// The opcodes that are read, by their names in `pickletools`.
mod opcode {
    pub const PROTO: u8 = 0x80;
    pub const FRAME: u8 = 0x95;
    pub const MARK: u8 = b'(';
    pub const NONE: u8 = b'N';
    pub const NEWTRUE: u8 = 0x88;
    pub const NEWFALSE: u8 = 0x89;
    pub const BININT: u8 = b'J';
    pub const BININT1: u8 = b'K';
    pub const BININT2: u8 = b'M';
    pub const LONG1: u8 = 0x8a;
    pub const BINFLOAT: u8 = b'G';
    pub const BINUNICODE: u8 = b'X';
    pub const BINSTRING: u8 = b'T';
    pub const SHORT_BINUNICODE: u8 = 0x8c;
    pub const SHORT_BINSTRING: u8 = b'U';
    pub const EMPTY_DICT: u8 = b'}';
    pub const EMPTY_LIST: u8 = b']';
    pub const EMPTY_TUPLE: u8 = b')';
    pub const TUPLE: u8 = b't';
    pub const TUPLE1: u8 = 0x85;
    pub const TUPLE3: u8 = 0x87;
    pub const APPEND: u8 = b'a';
    pub const APPENDS: u8 = b'e';
    pub const SETITEM: u8 = b's';
    pub const SETITEMS: u8 = b'u';
    pub const BINPUT: u8 = b'q';
    pub const LONG_BINPUT: u8 = b'r';
    pub const MEMOIZE: u8 = 0x94;
    pub const BINGET: u8 = b'h';
    pub const LONG_BINGET: u8 = b'j';
    pub const GLOBAL: u8 = b'c';
    pub const STACK_GLOBAL: u8 = 0x93;
    pub const REDUCE: u8 = b'R';
    pub const BUILD: u8 = b'b';
    pub const NEWOBJ: u8 = 0x81;
    pub const NEWOBJ_EX: u8 = 0x92;
    pub const BINBYTES: u8 = b'B';
    pub const SHORT_BINBYTES: u8 = b'C';
    pub const EMPTY_SET: u8 = 0x8f;
    pub const ADDITEMS: u8 = 0x90;
    pub const FROZENSET: u8 = 0x91;
    pub const POP: u8 = b'0';
    pub const BINPERSID: u8 = b'Q';
    pub const STOP: u8 = b'.';
}

/// The stack machine that executes a pickle.
struct Machine<'a> {
    input: &'a [u8],
    at: usize,
    /// Where the current opcode begins, for messages.
    opcode_at: usize,
    heap: Heap,
    stack: Vec<Id>,
    /// Heights of the stack at which a mark was set.
    marks: Vec<usize>,
    memo: HashMap<u32, Id>,
}

impl Machine<'_> {
    fn run(&mut self) -> Result<Id, Refusal> {
        loop {
            self.opcode_at = self.at;
            let opcode = self.byte()?;
            if opcode == opcode::STOP {
                return self.pop();
            }
            self.step(opcode)?;
        }
    }

    /// Executes one opcode other than `STOP`.
    fn step(&mut self, opcode: u8) -> Result<(), Refusal> {
        match opcode {
            opcode::PROTO => {
                let version = self.byte()?;
                if version > 5 {
                    return Err(self.refuse("protocol 0 to 5", version));
                }
            }
            opcode::FRAME => drop(self.take(8)?), // only a hint for buffering
            opcode::MARK => self.marks.push(self.stack.len()),
            opcode::NONE => self.push(Value::None),
            opcode::NEWTRUE => self.push(Value::Bool(true)),
            opcode::NEWFALSE => self.push(Value::Bool(false)),
            opcode::BININT => {
                let value = i32::from_le_bytes(self.array()?);
                self.push(Value::Int(value.into()));
            }
            opcode::BININT1 => {
                let value = self.byte()?;
                self.push(Value::Int(value.into()));
            }
            opcode::BININT2 => {
                let value = u16::from_le_bytes(self.array()?);
                self.push(Value::Int(value.into()));
            }
            opcode::LONG1 => {
                let length = self.byte()?;
                let value = self.long(length)?;
                self.push(Value::Int(value));
            }
            opcode::BINFLOAT => {
                self.take(8)?;
                self.push(Value::Float);
            }
            opcode::BINUNICODE | opcode::BINSTRING => {
                let length = u32::from_le_bytes(self.array()?);
                self.string(length)?;
            }
            opcode::SHORT_BINUNICODE | opcode::SHORT_BINSTRING => {
                let length = self.byte()?;
                self.string(length.into())?;
            }
            opcode::EMPTY_DICT => self.push(Value::Dict(Vec::new())),
            opcode::EMPTY_LIST => self.push(Value::List(Vec::new())),
            opcode::EMPTY_TUPLE => self.push(Value::Tuple(Vec::new())),
            opcode::TUPLE => {
                let items = self.pop_mark()?;
                self.push(Value::Tuple(items));
            }
            opcode::TUPLE1..=opcode::TUPLE3 => {
                let mut items = vec![Id(0); usize::from(opcode - opcode::TUPLE1) + 1];
                for item in items.iter_mut().rev() {
                    *item = self.pop()?;
                }
                self.push(Value::Tuple(items));
            }
            opcode::APPEND => {
                let item = self.pop()?;
                self.append(vec![item])?;
            }
            opcode::APPENDS => {
                let items = self.pop_mark()?;
                self.append(items)?;
            }
            opcode::SETITEM => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.set(vec![key, value])?;
            }
            opcode::SETITEMS => {
                let items = self.pop_mark()?;
                self.set(items)?;
            }
            opcode::BINPUT => {
                let slot = self.byte()?;
                self.remember(slot.into())?;
            }
            opcode::LONG_BINPUT => {
                let slot = u32::from_le_bytes(self.array()?);
                self.remember(slot)?;
            }
            opcode::MEMOIZE => self.remember(self.memo.len() as u32)?,
            opcode::BINGET => {
                let slot = self.byte()?;
                self.recall(slot.into())?;
            }
            opcode::LONG_BINGET => {
                let slot = u32::from_le_bytes(self.array()?);
                self.recall(slot)?;
            }
            opcode::GLOBAL => {
                let module = self.line()?;
                let name = self.line()?;
                self.global(&module, &name);
            }
            opcode::STACK_GLOBAL => {
                let (name, module) = (self.pop()?, self.pop()?);
                match (self.heap.get(module).clone(), self.heap.get(name).clone()) {
                    (Value::Str(module), Value::Str(name)) => self.global(&module, &name),
                    (module, _) => {
                        return Err(self.refuse("two strings for STACK_GLOBAL", module.kind()));
                    }
                }
            }
            opcode::REDUCE => self.reduce()?,
            opcode::BUILD => {
                // No tensor needs attributes: neither an OrderedDict's (`_metadata` of a state
                // dict) nor those of an object of an unknown class.
                self.pop()?;
                let object = self.top()?;
                if !matches!(self.heap.get(object), Value::Dict(_) | Value::Opaque(_)) {
                    let expected = "BUILD of an OrderedDict or an object";
                    return Err(self.refuse(expected, self.heap.get(object).kind()));
                }
            }
            opcode::NEWOBJ => {
                self.pop()?; // the arguments
                self.object()?;
            }
            opcode::NEWOBJ_EX => {
                self.pop()?; // the keyword arguments
                self.pop()?; // the arguments
                self.object()?;
            }
            opcode::BINBYTES => {
                let length = u32::from_le_bytes(self.array()?);
                self.bytes(length as usize)?;
            }
            opcode::SHORT_BINBYTES => {
                let length = self.byte()?;
                self.bytes(length.into())?;
            }
            opcode::EMPTY_SET => self.push(Value::Opaque("set".into())),
            opcode::ADDITEMS => {
                self.pop_mark()?;
                let set = self.top()?;
                if !matches!(self.heap.get(set), Value::Opaque(_)) {
                    return Err(self.refuse("ADDITEMS to a set", self.heap.get(set).kind()));
                }
            }
            opcode::FROZENSET => {
                self.pop_mark()?;
                self.push(Value::Opaque("frozenset".into()));
            }
            opcode::POP => drop(self.pop()?),
            opcode::BINPERSID => {
                let id = self.pop()?;
                let storage = torch::storage(&self.heap, id).map_err(|error| self.place(error))?;
                self.push(Value::Storage(Box::new(storage)));
            }
            _ => return Err(self.refuse("an opcode of plain data", name_of(opcode))),
        }
        Ok(())
    }

    /// Calls a known function, or makes an opaque object of an unknown one.
    fn reduce(&mut self) -> Result<(), Refusal> {
        let arguments = self.pop()?;
        let callable = self.pop()?;
        let Value::Tuple(items) = self.heap.get(arguments) else {
            return Err(self.refuse("a tuple of arguments", self.heap.get(arguments).kind()));
        };
        let global = match self.heap.get(callable) {
            Value::Global(global) => global,
            Value::Opaque(name) if torch::runs_code(name) => {
                return Err(self.refuse("a global of a plain state dict", format!("`{name}`")));
            }
            Value::Opaque(name) => {
                let name = name.clone();
                self.push(Value::Opaque(name));
                return Ok(());
            }
            other => return Err(self.refuse("REDUCE of a global", other.kind())),
        };
        let value = torch::call(&self.heap, global, items).map_err(|error| self.place(error))?;
        self.push(value);
        Ok(())
    }

    /// Pushes a global, which is opaque if it is not known.
    fn global(&mut self, module: &str, name: &str) {
        let value = match torch::global(module, name) {
            Some(global) => Value::Global(global),
            None => Value::Opaque(brief(format!("{module}.{name}"))),
        };
        self.push(value);
    }

    /// Replaces a class on the stack by an object of it.
    fn object(&mut self) -> Result<(), Refusal> {
        let class = self.pop()?;
        let value = match self.heap.get(class) {
            Value::Opaque(name) => Value::Opaque(name.clone()),
            Value::Global(Global::OrderedDict) => Value::Dict(Vec::new()),
            other => return Err(self.refuse("NEWOBJ of a class", other.kind())),
        };
        self.push(value);
        Ok(())
    }

    /// Skips raw bytes, which no tensor of a state dict consists of.
    fn bytes(&mut self, length: usize) -> Result<(), Refusal> {
        self.take(length)?;
        self.push(Value::Opaque("bytes".into()));
        Ok(())
    }

    fn append(&mut self, items: Vec<Id>) -> Result<(), Refusal> {
        let target = self.top()?;
        match &mut self.heap.values[target.0 as usize] {
            Value::List(list) => list.extend(items),
            Value::Opaque(_) => {} // a list of an unknown class
            other => {
                let kind = other.kind();
                return Err(self.refuse("APPEND to a list", kind));
            }
        }
        Ok(())
    }

    fn set(&mut self, items: Vec<Id>) -> Result<(), Refusal> {
        if !items.len().is_multiple_of(2) {
            return Err(self.refuse("pairs for SETITEMS", items.len()));
        }
        let target = self.top()?;
        match &mut self.heap.values[target.0 as usize] {
            Value::Dict(dict) => dict.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1]))),
            Value::Opaque(_) => {} // a dict of an unknown class
            other => {
                let kind = other.kind();
                return Err(self.refuse("SETITEM of a dict", kind));
            }
        }
        Ok(())
    }

    fn push(&mut self, value: Value) {
        let id = self.heap.add(value);
        self.stack.push(id);
    }

    /// The topmost value above the last mark.
    fn top(&self) -> Result<Id, Refusal> {
        let floor = self.marks.last().copied().unwrap_or(0);
        match self.stack[floor..].last() {
            Some(&id) => Ok(id),
            None => Err(self.refuse("a value on the stack", "none")),
        }
    }

    fn pop(&mut self) -> Result<Id, Refusal> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    fn pop_mark(&mut self) -> Result<Vec<Id>, Refusal> {
        match self.marks.pop() {
            Some(mark) => Ok(self.stack.split_off(mark)),
            None => Err(self.refuse("a mark on the stack", "none")),
        }
    }

    fn remember(&mut self, slot: u32) -> Result<(), Refusal> {
        let top = self.top()?;
        self.memo.insert(slot, top);
        Ok(())
    }

    fn recall(&mut self, slot: u32) -> Result<(), Refusal> {
        match self.memo.get(&slot) {
            Some(&id) => self.stack.push(id),
            None => return Err(self.refuse("a memo slot that was filled", slot)),
        }
        Ok(())
    }

    /// Reads a string and pushes it.
    fn string(&mut self, length: u32) -> Result<(), Refusal> {
        let bytes = self.take(length as usize)?;
        match std::str::from_utf8(bytes) {
            Ok(text) => {
                let text = Value::Str(text.to_owned());
                self.push(text);
                Ok(())
            }
            Err(_) => Err(self.refuse("a string in UTF-8", format!("{length} other bytes"))),
        }
    }

    /// Reads a little-endian two's complement integer of up to 16 bytes.
    fn long(&mut self, length: u8) -> Result<i128, Refusal> {
        let length = usize::from(length);
        if length > 16 {
            return Err(self.refuse("an integer of at most 16 bytes", length));
        }
        let bytes = self.take(length)?;
        let negative = bytes.last().is_some_and(|last| last & 0x80 != 0);
        let mut wide = [if negative { 0xff } else { 0 }; 16];
        wide[..length].copy_from_slice(bytes);
        Ok(i128::from_le_bytes(wide))
    }

    /// Reads a line, which is a module or a name and so must be short.
    fn line(&mut self) -> Result<String, Refusal> {
        let rest = &self.input[self.at..];
        let Some(length) = rest.iter().take(256).position(|&byte| byte == b'\n') else {
            return Err(self.refuse("a line of at most 255 bytes", "a longer one"));
        };
        let bytes = self.take(length + 1)?;
        Ok(String::from_utf8_lossy(&bytes[..length]).into_owned())
    }

    fn byte(&mut self) -> Result<u8, Refusal> {
        Ok(self.array::<1>()?[0])
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Refusal> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn take(&mut self, length: usize) -> Result<&[u8], Refusal> {
        let rest = &self.input[self.at..];
        if length > rest.len() {
            let found = if self.input.len() == MAX_BYTES {
                format!("the bound of {MAX_BYTES} bytes per pickle")
            } else {
                format!("the end after {}", rest.len())
            };
            return Err(self.refuse(format!("{length} more bytes"), found));
        }
        self.at += length;
        Ok(&rest[..length])
    }

    fn refuse(&self, expected: impl ToString, found: impl ToString) -> Refusal {
        Refusal::new(format!("pickle, byte {}", self.opcode_at), expected, found)
    }

    /// Adds the byte to a refusal that does not know it.
    fn place(&self, refusal: Refusal) -> Refusal {
        Refusal {
            place: format!("pickle, byte {}: {}", self.opcode_at, refusal.place),
            ..refusal
        }
    }
}

/// Name of an opcode that is not accepted.
fn name_of(opcode: u8) -> String {
    let name = match opcode {
        b'1' => "POP_MARK",
        b'2' => "DUP",
        b'F' => "FLOAT",
        b'I' => "INT",
        b'L' => "LONG",
        b'P' => "PERSID",
        b'S' => "STRING",
        b'V' => "UNICODE",
        b'd' => "DICT",
        b'g' => "GET",
        b'i' => "INST",
        b'l' => "LIST",
        b'o' => "OBJ",
        b'p' => "PUT",
        0x82..=0x84 => "EXT",
        0x8b => "LONG4",
        0x8d => "BINUNICODE8",
        0x8e => "BINBYTES8",
        0x96 => "BYTEARRAY8",
        0x97 => "NEXT_BUFFER",
        0x98 => "READONLY_BUFFER",
        _ => return format!("byte {opcode:#04x}"),
    };
    format!("opcode {name}")
}
