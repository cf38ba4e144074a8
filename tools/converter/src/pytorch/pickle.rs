//! The pickle of a state dict: protocol 2, and only what `torch.load(weights_only=True)` accepts.

/// Bytes of a pickle, opcode by opcode.
#[derive(Clone, Debug)]
pub struct Pickle(Vec<u8>);

impl Pickle {
    /// A dict that begins.
    pub fn dict() -> Pickle {
        Pickle(b"\x80\x02}(".to_vec())
    }

    /// An entry: a contiguous tensor that is the whole of the storage `key`, of a class of `torch`.
    pub fn tensor(&mut self, name: &str, class: &str, key: &str, shape: &[usize]) {
        self.text(name);
        self.raw(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        self.text("storage");
        self.raw(b"ctorch\n");
        self.raw(class.as_bytes());
        self.raw(b"\n");
        self.text(key);
        self.text("cpu");
        self.int(shape.iter().product());
        self.raw(b"tQ"); // the storage, as a persistent id
        self.int(0); // where in it the tensor begins
        self.ints(shape.iter().copied());
        self.ints((0..shape.len()).map(|i| shape[i + 1..].iter().product()));
        self.raw(b"\x89"); // needs no gradient
        self.raw(b"ccollections\nOrderedDict\n)RtR"); // no hooks
    }

    /// The end of the dict and of the pickle.
    pub fn finish(mut self) -> Vec<u8> {
        self.raw(b"u.");
        self.0
    }

    fn raw(&mut self, bytes: &[u8]) {
        self.0.extend(bytes);
    }

    fn text(&mut self, text: &str) {
        self.raw(b"X");
        self.raw(&(text.len() as u32).to_le_bytes());
        self.raw(text.as_bytes());
    }

    /// An integer of eight bytes, whatever it is.
    fn int(&mut self, value: usize) {
        self.raw(&[0x8a, 8]);
        self.raw(&(value as u64).to_le_bytes());
    }

    fn ints(&mut self, values: impl Iterator<Item = usize>) {
        self.raw(b"(");
        values.for_each(|value| self.int(value));
        self.raw(b"t");
    }
}
