//! A dense array of `f32` with its shape.

use kernels::Size;

/// A dense array of `f32`, last extent innermost. Batches of maps are
/// `[batch, height, width, channels]`, scalars `[]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    shape: Vec<usize>,
    data: Vec<f32>,
}

impl Tensor {
    /// `data` in `shape`. Panics if there are not as many values as the shape has.
    pub fn new(shape: &[usize], data: Vec<f32>) -> Tensor {
        assert_eq!(
            shape.iter().product::<usize>(),
            data.len(),
            "values of a tensor {shape:?}"
        );
        Tensor {
            shape: shape.to_vec(),
            data,
        }
    }

    /// All values `value`.
    pub fn full(shape: &[usize], value: f32) -> Tensor {
        Tensor {
            shape: shape.to_vec(),
            data: vec![value; shape.iter().product()],
        }
    }

    /// All values 0.
    pub fn zeros(shape: &[usize]) -> Tensor {
        Tensor::full(shape, 0.0)
    }

    /// One value, of shape `[]`.
    pub fn scalar(value: f32) -> Tensor {
        Tensor {
            shape: vec![],
            data: vec![value],
        }
    }

    /// Its extents.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// Its values.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Its values, to write.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Its values, without the shape.
    pub fn into_data(self) -> Vec<f32> {
        self.data
    }

    /// The one value of a tensor of one. Panics if there are more.
    pub fn item(&self) -> f32 {
        assert_eq!(
            self.data.len(),
            1,
            "the one value of a tensor {:?}",
            self.shape
        );
        self.data[0]
    }

    /// Extents of a batch of maps. Panics, naming the caller `what`, if the tensor is not one.
    pub(crate) fn maps(&self, what: &str) -> Maps {
        let [batch, h, w, channels] = self.shape[..] else {
            panic!(
                "{what} needs maps [batch, height, width, channels], found {:?}",
                self.shape
            )
        };
        assert!(
            batch > 0 && h > 0 && w > 0 && channels > 0,
            "{what} needs maps, found {:?}",
            self.shape
        );
        Maps {
            batch,
            size: Size { h, w },
            channels,
        }
    }

    /// Extents as rows of the innermost one: `(rows, columns)`. Panics if there are none.
    pub(crate) fn rows(&self, what: &str) -> (usize, usize) {
        match self.shape[..] {
            [.., columns] if columns > 0 => (self.data.len() / columns, columns),
            _ => panic!("{what} needs rows [.., columns], found {:?}", self.shape),
        }
    }
}

/// Extents of a batch of maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Maps {
    pub batch: usize,
    pub size: Size,
    pub channels: usize,
}

impl Maps {
    /// The shape that has these extents.
    pub fn shape(&self) -> [usize; 4] {
        [self.batch, self.size.h, self.size.w, self.channels]
    }

    /// Values of one image.
    pub fn image(&self) -> usize {
        self.size.area() * self.channels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensor_shapes_give_extents() {
        assert_eq!(Tensor::scalar(2.0).item(), 2.0);
        let maps = Tensor::zeros(&[2, 3, 4, 5]).maps("test");
        assert_eq!((maps.image(), maps.shape()), (60, [2, 3, 4, 5]));
        assert_eq!(Tensor::zeros(&[2, 3, 4]).rows("test"), (6, 4));
    }

    #[test]
    #[should_panic(expected = "values of a tensor [2, 2]")]
    fn tensor_with_a_wrong_count_panics() {
        Tensor::new(&[2, 2], vec![0.0; 3]);
    }

    #[test]
    #[should_panic(expected = "pool needs maps [batch, height, width, channels], found [2, 3]")]
    fn maps_of_a_matrix_panics() {
        Tensor::zeros(&[2, 3]).maps("pool");
    }
}
