//! A Python object as a [`Frame`]. The bytes stay where NumPy keeps them if the frame's form allows
//! it: whole pixels side by side, rows at any distance.
//!
//! Lent without a copy: contiguous arrays, cut-outs, every n-th row, `bgr[..., ::-1]` (the same
//! bytes in the other order) and `bgra[..., :3]`. Copied: mirrored and transposed arrays, every
//! n-th column, one channel of several, PIL images. YUV comes as OpenCV has it: rows of luma, then
//! those of chroma, in one array (3 H / 2) x W; or H x W x 2.

use numpy::{
    PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use track_cpu::{ChannelOrder, Frame, FrameError};

use crate::failure::Failure;

const EXPECTED: &str =
    "a NumPy array of uint8, H x W (gray), H x W x 3 or H x W x 4, or a PIL image";

/// Order of the samples in an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Colors in the last dimension as OpenCV has them.
    Bgr,
    /// Colors in the last dimension as PIL, imageio and PyTorch have them.
    Rgb,
    /// Luma and chroma as cameras and decoders have them.
    Yuv(ChannelOrder),
}

/// YUV by name.
const YUV: [(&str, ChannelOrder); 5] = [
    ("nv12", ChannelOrder::Nv12),
    ("nv21", ChannelOrder::Nv21),
    ("i420", ChannelOrder::I420),
    ("yuyv", ChannelOrder::Yuyv),
    ("uyvy", ChannelOrder::Uyvy),
];

impl Order {
    /// # Errors
    /// If there is no order of this name.
    pub fn from_name(name: &str) -> Result<Order, Failure> {
        match name {
            "bgr" => Ok(Order::Bgr),
            "rgb" => Ok(Order::Rgb),
            _ => match YUV.iter().find(|(known, _)| *known == name) {
                Some((_, order)) => Ok(Order::Yuv(*order)),
                None => Err(Failure::Argument(format!(
                    "order is {name:?}, expected \"bgr\" (as OpenCV), \"rgb\", or one of {:?}",
                    YUV.map(|(known, _)| known)
                ))),
            },
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Order::Bgr => "bgr",
            Order::Rgb => "rgb",
            Order::Yuv(order) => {
                let found = YUV.iter().find(|(_, known)| *known == order);
                found.map_or("yuv", |(name, _)| name)
            }
        }
    }

    fn reversed(self) -> Order {
        match self {
            Order::Bgr => Order::Rgb,
            Order::Rgb => Order::Bgr,
            yuv => yuv,
        }
    }

    /// Rows of the picture in an array of so many rows; `None` if it cannot have that many.
    fn height(self, rows: usize) -> Option<usize> {
        match self {
            Order::Yuv(ChannelOrder::Nv12 | ChannelOrder::Nv21 | ChannelOrder::I420) => {
                let height = 2 * rows / 3;
                (height > 0 && height + height.div_ceil(2) == rows).then_some(height)
            }
            _ => Some(rows),
        }
    }

    fn of_pixels(self, bytes: usize) -> ChannelOrder {
        match (self, bytes) {
            (Order::Yuv(order), _) => order,
            (_, 1) => ChannelOrder::Gray,
            (Order::Bgr, 4) => ChannelOrder::Bgra,
            (Order::Rgb, 4) => ChannelOrder::Rgba,
            (Order::Bgr, _) => ChannelOrder::Bgr,
            (Order::Rgb, _) => ChannelOrder::Rgb,
        }
    }
}

/// A picture within the bytes of an array, which it keeps alive.
pub struct Image<'py> {
    bytes: PyReadonlyArrayDyn<'py, u8>, // contiguous
    layout: Layout,
}

/// Where a picture lies within an array's bytes.
#[derive(Clone, Copy, Debug)]
struct Layout {
    start: usize,
    width: usize,
    height: usize,
    stride: usize,
    order: ChannelOrder,
}

impl<'py> Image<'py> {
    /// The picture that an object holds. A PIL image's colors are RGB whatever `order` says.
    ///
    /// # Errors
    /// If the object is not an array of bytes in one of the known shapes.
    pub fn of(object: &Bound<'py, PyAny>, order: Order) -> PyResult<Image<'py>> {
        let (array, order) = as_array(object, order)?;
        let shape = Shape::of(&array, order)?;
        if let Some(image) = Image::lent(&array, shape, order)? {
            return Ok(image);
        }
        let numpy = object.py().import("numpy")?;
        let copy = numpy.call_method1("ascontiguousarray", (&array,))?;
        let bytes = copy.cast_into::<PyArrayDyn<u8>>()?.try_readonly()?;
        let layout = Layout {
            start: 0,
            width: shape.width,
            height: shape.height,
            stride: shape.width * shape.channels,
            order: order.of_pixels(shape.channels),
        };
        Ok(Image { bytes, layout })
    }

    /// The picture without a copy; `None` if its bytes lie in another form than a frame's.
    fn lent(
        array: &Bound<'py, PyArrayDyn<u8>>,
        shape: Shape,
        order: Order,
    ) -> PyResult<Option<Image<'py>>> {
        let Some((stride, pixels)) = shape.strides(array.strides()) else {
            return Ok(None);
        };
        // A row of the array holds two rows of chroma without a gap between them.
        if order == Order::Yuv(ChannelOrder::I420) && stride != shape.width {
            return Ok(None);
        }
        let Some(owner) = owner(array)? else {
            return Ok(None);
        };
        let order = if pixels.reversed {
            order.reversed()
        } else {
            order
        };
        let first = array.data().addr() - if pixels.reversed { 2 } else { 0 };
        let layout = Layout {
            start: first.wrapping_sub(owner.data().addr()),
            width: shape.width,
            height: shape.height,
            stride,
            order: order.of_pixels(pixels.bytes),
        };
        let bytes = owner.try_readonly()?;
        let rows = stride.saturating_mul(shape.rows - 1);
        let needed = rows.saturating_add(shape.width * pixels.bytes);
        let rest = bytes.as_slice()?.get(layout.start..);
        let lent = rest.is_some_and(|rest| rest.len() >= needed);
        Ok(lent.then_some(Image { bytes, layout }))
    }

    /// The picture as the tracker takes it.
    ///
    /// # Errors
    /// If a side is too large.
    pub fn frame(&self) -> PyResult<Frame<'_>> {
        let Layout {
            start,
            width,
            height,
            stride,
            order,
        } = self.layout;
        let bytes = self.bytes.as_slice()?.get(start..).unwrap_or_default();
        let frame = Frame::with_stride(bytes, width, height, stride, order);
        Ok(frame.map_err(Failure::from)?)
    }
}

/// Sides and channels of an array that holds a picture.
#[derive(Clone, Copy, Debug)]
struct Shape {
    rows: usize, // of the array
    height: usize,
    width: usize,
    channels: usize,
}

/// How the pixels of a row lie in memory.
#[derive(Clone, Copy, Debug)]
struct Pixels {
    bytes: usize,
    /// The array begins with the last color.
    reversed: bool,
}

impl Shape {
    fn of(array: &Bound<'_, PyArrayDyn<u8>>, order: Order) -> Result<Shape, Failure> {
        let refused = |expected: &str| {
            let found = array.shape();
            Failure::Argument(format!(
                "image has the shape {found:?}, expected {expected}"
            ))
        };
        let (rows, width, channels) = match (order, array.shape()) {
            (Order::Yuv(ChannelOrder::Yuyv | ChannelOrder::Uyvy), &[rows, width, 2])
                if width.is_multiple_of(2) =>
            {
                (rows, width, 2)
            }
            (Order::Yuv(ChannelOrder::Yuyv | ChannelOrder::Uyvy), _) => {
                return Err(refused("H x W x 2 with an even W"));
            }
            (Order::Yuv(_), &[rows, width] | &[rows, width, 1]) if width.is_multiple_of(2) => {
                (rows, width, 1)
            }
            (Order::Yuv(_), _) => return Err(refused("(3 H / 2) x W with an even W")),
            (_, &[rows, width]) => (rows, width, 1),
            (_, &[rows, width, channels @ (1 | 3 | 4)]) => (rows, width, channels),
            _ => return Err(refused(EXPECTED)),
        };
        let Some(height) = order.height(rows) else {
            return Err(refused("(3 H / 2) x W"));
        };
        let max = Frame::MAX_SIDE;
        if !(1..=max).contains(&width) || !(1..=max).contains(&height) {
            return Err(FrameError::Size { width, height, max }.into());
        }
        Ok(Shape {
            rows,
            height,
            width,
            channels,
        })
    }

    /// Bytes from row to row, and how a row's pixels lie; `None` if no frame has this form.
    fn strides(&self, strides: &[isize]) -> Option<(usize, Pixels)> {
        // NumPy leaves the stride of a dimension of one open.
        let pixel = if self.width == 1 {
            self.channels as isize
        } else {
            strides[1]
        };
        let channel = if self.channels == 1 { 1 } else { strides[2] };
        let (bytes, reversed) = match (self.channels, pixel, channel) {
            (1, 1, _) => (1, false),
            (2, 2, 1) => (2, false),
            (3, 3, 1) => (3, false),
            (3, 3, -1) => (3, true),
            (3 | 4, 4, 1) => (4, false),
            (3, 4, -1) => (4, true),
            _ => return None,
        };
        let row = self.width * bytes;
        let stride = if self.rows == 1 {
            row
        } else {
            usize::try_from(strides[0]).ok()?
        };
        (stride >= row).then_some((stride, Pixels { bytes, reversed }))
    }
}

/// The contiguous array that holds an array's bytes: itself, or the one that it is a view of.
fn owner<'py>(array: &Bound<'py, PyArrayDyn<u8>>) -> PyResult<Option<Bound<'py, PyArrayDyn<u8>>>> {
    if array.is_contiguous() {
        return Ok(Some(array.clone()));
    }
    let base = array.getattr("base")?.cast_into::<PyArrayDyn<u8>>().ok();
    Ok(base.filter(|base| base.is_contiguous()))
}

/// The object as an array, and the order of its colors.
fn as_array<'py>(
    object: &Bound<'py, PyAny>,
    order: Order,
) -> PyResult<(Bound<'py, PyArrayDyn<u8>>, Order)> {
    if let Ok(array) = object.cast::<PyArrayDyn<u8>>() {
        return Ok((array.clone(), order));
    }
    if object.is_none() {
        let reason = "OpenCV gives None at the end of a video and for a missing file";
        return Err(refused("None", reason));
    }
    let kind = object.get_type();
    let order = if kind.hasattr("getbands")? {
        let mode: String = object.getattr("mode")?.extract()?;
        if !["L", "RGB", "RGBA", "RGBX"].contains(&mode.as_str()) {
            return Err(refused(
                &format!("a PIL image of mode {mode}"),
                "image.convert(\"RGB\") makes one that is taken",
            ));
        }
        Order::Rgb
    } else {
        order
    };
    let mut array = object.clone();
    if object.cast::<PyUntypedArray>().is_err() {
        // Asked of the type: to ask a PIL image means to copy it.
        let interfaces = ["__array_interface__", "__array_struct__", "__array__"];
        let mut is_array = false;
        for name in interfaces {
            is_array |= kind.hasattr(name)?;
        }
        if !is_array {
            return Err(refused(&format!("a {}", kind.name()?), "read it first"));
        }
        array = object
            .py()
            .import("numpy")?
            .call_method1("asarray", (object,))?;
    }
    array
        .cast_into::<PyArrayDyn<u8>>()
        .map(|array| (array, order))
        .map_err(|error| {
            let dtype = error.into_inner().getattr("dtype");
            let dtype = dtype.map_or_else(|_| "objects".into(), |dtype| dtype.to_string());
            refused(
                &format!("an array of {dtype}"),
                "samples from 0 to 1 become bytes by (255 * image).astype(numpy.uint8)",
            )
        })
}

fn refused(found: &str, hint: &str) -> PyErr {
    Failure::Argument(format!("image is {found}, expected {EXPECTED}: {hint}")).into()
}
