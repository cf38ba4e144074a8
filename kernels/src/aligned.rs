//! Memory for weights and scratch: aligned to cache lines, so that no vector lies across two, and
//! in huge pages if large.

use crate::simd::Line;
use bytemuck::Pod;
use memmap2::MmapMut;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// A growable run of values that starts at a cache line (64 bytes).
#[derive(Clone, Debug)]
pub struct Aligned<T> {
    memory: Memory,
    len: usize, // values; memory after them is stale
    values: PhantomData<T>,
}

impl<T> Default for Aligned<T> {
    fn default() -> Aligned<T> {
        Aligned {
            memory: Memory::Heap(Vec::new()),
            len: 0,
            values: PhantomData,
        }
    }
}

impl<T: Pod> Aligned<T> {
    /// `len` zeros.
    pub fn zeros(len: usize) -> Aligned<T> {
        let mut values = Aligned::default();
        values.resize(len);
        values
    }

    /// Changes the length to `len`; new values are 0. Allocates only beyond the largest length so
    /// far.
    pub fn resize(&mut self, len: usize) {
        let lines = (len * size_of::<T>()).div_ceil(size_of::<Line>());
        if lines > self.memory.len() {
            let mut larger = Memory::zeros(lines);
            larger[..self.memory.len()].copy_from_slice(&self.memory);
            self.memory = larger;
        }
        let before = std::mem::replace(&mut self.len, len);
        if let Some(new) = self.get_mut(before..) {
            new.fill(T::zeroed());
        }
    }

    /// Drops all values, but keeps their memory.
    pub fn clear(&mut self) {
        self.len = 0;
    }
}

impl<T: Pod> Deref for Aligned<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        &bytemuck::cast_slice(&self.memory)[..self.len]
    }
}

impl<T: Pod> DerefMut for Aligned<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        &mut bytemuck::cast_slice_mut(&mut self.memory)[..self.len]
    }
}

/// Cache lines.
#[derive(Debug)]
enum Memory {
    Heap(Vec<Line>),
    Mapped(MmapMut),
}

impl Memory {
    /// Lines of a huge page of 2 MiB. From this size on, memory is requested in huge pages.
    ///
    /// A network's transformed kernels are read from end to end in every pass. In pages of 4 KiB
    /// they would miss the TLB at every page.
    const HUGE: usize = (2 << 20) / size_of::<Line>();

    fn zeros(lines: usize) -> Memory {
        let bytes = lines * size_of::<Line>();
        let map = if lines >= Memory::HUGE {
            MmapMut::map_anon(bytes).ok()
        } else {
            None
        };
        match map {
            Some(map) => {
                #[cfg(target_os = "linux")]
                let _ = map.advise(memmap2::Advice::HugePage); // a hint: small pages work as well
                Memory::Mapped(map)
            }
            None => Memory::Heap(vec![Line::ZERO; lines]),
        }
    }
}

impl Clone for Memory {
    fn clone(&self) -> Memory {
        let mut copy = Memory::zeros(self.len());
        copy.copy_from_slice(self);
        copy
    }
}

impl Deref for Memory {
    type Target = [Line];

    #[inline]
    fn deref(&self) -> &[Line] {
        match self {
            Memory::Heap(lines) => lines,
            Memory::Mapped(map) => bytemuck::cast_slice(map),
        }
    }
}

impl DerefMut for Memory {
    #[inline]
    fn deref_mut(&mut self) -> &mut [Line] {
        match self {
            Memory::Heap(lines) => lines,
            Memory::Mapped(map) => bytemuck::cast_slice_mut(map),
        }
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
    fn values_of_any_length_start_at_a_cache_line() {
        for len in [1, 15, 16, 17, 1000, 100_000, 3_000_000] {
            assert!(
                Aligned::<f32>::zeros(len)
                    .as_ptr()
                    .addr()
                    .is_multiple_of(64)
            );
            assert!(Aligned::<u8>::zeros(len).as_ptr().addr().is_multiple_of(64));
        }
    }

    #[test]
    fn values_after_a_resize_are_zero_where_new() {
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

    #[test]
    fn values_in_huge_pages_resize_and_clone_like_few() {
        let mut values = Aligned::from(&[7u8; 100][..]);
        values.resize(5_000_000);
        assert!(
            values[..100].iter().all(|value| *value == 7)
                && values[100..].iter().all(|value| *value == 0)
        );
        values[4_999_999] = 9;
        let copy = values.clone();
        values.resize(4_999_999);
        values.resize(5_000_000);
        assert_eq!(
            (values[4_999_999], copy[4_999_999], copy.len()),
            (0, 9, 5_000_000)
        );
    }
}
