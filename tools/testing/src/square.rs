//! A video of one textured square over a textured ground.

/// A square that moves by the same step in every frame; its true boxes are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingSquare {
    /// Width of the frames in pixels.
    pub width: usize,
    /// Height of the frames in pixels.
    pub height: usize,
    /// Left edge of the square in frame 0.
    pub x: usize,
    /// Top edge of the square in frame 0.
    pub y: usize,
    /// Side of the square in pixels.
    pub side: usize,
    /// Pixels by which it moves to the right per frame.
    pub step_x: usize,
    /// Pixels by which it moves down per frame.
    pub step_y: usize,
}

impl Default for MovingSquare {
    fn default() -> MovingSquare {
        MovingSquare {
            width: 160,
            height: 120,
            x: 20,
            y: 40,
            side: 24,
            step_x: 4,
            step_y: 1,
        }
    }
}

impl MovingSquare {
    /// The true box in frame `i`: left, top, width, height.
    pub fn bbox(&self, i: usize) -> [usize; 4] {
        let x = self.x + i * self.step_x;
        let y = self.y + i * self.step_y;
        [x, y, self.side, self.side]
    }

    /// Frame `i` as interleaved RGB, `[height, width, 3]`.
    pub fn frame(&self, i: usize) -> Vec<u8> {
        let [left, top, w, h] = self.bbox(i);
        let mut pixels = Vec::with_capacity(3 * self.width * self.height);
        for y in 0..self.height {
            for x in 0..self.width {
                let is_inside = (left..left + w).contains(&x) && (top..top + h).contains(&y);
                // Both textures are attached to what they lie on, so that the square moves as one.
                let pixel = if is_inside {
                    let check = ((x - left) / 4 + (y - top) / 4) % 2;
                    [230, 60 + 120 * check as u8, 40]
                } else {
                    let mixed = (x * 7 + y * 13) % 29;
                    [70 + mixed as u8, 90 + mixed as u8, 80]
                };
                pixels.extend(pixel);
            }
        }
        pixels
    }

    /// The true boxes of the first `frames` frames as an annotation file: `x,y,w,h`, a line each.
    pub fn annotation(&self, frames: usize) -> String {
        let mut text = String::new();
        for i in 0..frames {
            let [x, y, w, h] = self.bbox(i);
            text += &format!("{x},{y},{w},{h}\n");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn square_moves_by_its_step() {
        let video = MovingSquare::default();
        let corner = |i: usize| {
            let [x, y, ..] = video.bbox(i);
            let at = 3 * (y * video.width + x);
            video.frame(i)[at..at + 3].to_vec()
        };

        assert_eq!(corner(0), [230, 60, 40]);
        assert_eq!(corner(5), [230, 60, 40]);
        assert_eq!(video.annotation(2), "20,40,24,24\n24,41,24,24\n");
    }
}
