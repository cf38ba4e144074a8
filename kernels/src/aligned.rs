//! Values that begin with a cache line, so that no vector of them lies across two.

use crate::simd::Line;
use bytemuck::Pod;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// A growable run of values, the first of them at the start of a cache line (64 bytes).
#[derive(Clone, Debug)]
pub struct Aligned<T> {
    lines: Vec<Line>,
    len: usize, // values
    values: PhantomData<T>,
}

impl<T> Default for Aligned<T> {
    fn default() -> Aligned<T> {
        Aligned { lines: Vec::new(), len: 0, values: PhantomData }
    }
}

impl<T: Pod> Aligned<T> {
    /// `len` zeros.
    pub fn zeros(len: usize) -> Aligned<T> {
        let mut values = Aligned::default();
        values.resize(len);
        values
    }

    /// Becomes `len` values, zeros behind those that were there; allocates only beyond the most so far.
    pub fn resize(&mut self, len: usize) {
        let before = std::mem::replace(&mut self.len, len);
        let there = self.lines.len() * size_of::<Line>() / size_of::<T>(); // values, those beyond the last one stale
        self.lines.resize((len * size_of::<T>()).div_ceil(size_of::<Line>()), Line::ZERO);
        if let Some(stale) = self.get_mut(before..there.min(len)) {
            stale.fill(T::zeroed());
        }
    }

    /// Drops all values, not the room for them.
    pub fn clear(&mut self) {
        self.len = 0;
        self.lines.clear();
    }
}

impl<T: Pod> Deref for Aligned<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }
}

impl<T: Pod> DerefMut for Aligned<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
    }
}

impl<T: Pod> From<&[T]> for Aligned<T> {
    fn from(values: &[T]) -> Aligned<T> {
        let mut aligned = Aligned::zeros(values.len());
        aligned.copy_from_slice(values);
        aligned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_begin_with_a_line() {
        for len in [1, 15, 16, 17, 1000, 100_000] {
            assert!(Aligned::<f32>::zeros(len).as_ptr().addr().is_multiple_of(64));
            assert!(Aligned::<u8>::zeros(len).as_ptr().addr().is_multiple_of(64));
        }
    }

    #[test]
    fn what_is_new_is_zero() {
        let mut values = Aligned::from(&[1u8, 2, 3, 4, 5][..]);
        values.resize(2);
        values.resize(100);
        assert_eq!(values[..4], [1, 2, 0, 0]);
        assert!(values[2..].iter().all(|value| *value == 0) && values.len() == 100);
        values.clear();
        values.resize(3);
        assert_eq!(*values, [0, 0, 0]);
        assert!(Aligned::<[i8; 4]>::zeros(0).is_empty());
    }
}
