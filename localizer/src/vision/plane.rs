//! Class probabilities of an image, 8 bits each.
//!
//! Probabilities are kept as bytes (`value / 255`): a run on saved maps and a
//! run on the networks themselves then see the same numbers, and the step,
//! 0.4 %, is far below what a network's probability means.

use fast_image_resize::PixelType;

use super::Error;

/// What a probability map is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Class {
    /// Poles, posts, masts.
    Pole,
    /// Traffic signs.
    Sign,
    /// Traffic lights.
    Light,
    /// Lane lines.
    Lane,
    /// Trees, hedges and all else that grows, of which trunks are made.
    Vegetation,
}

impl Class {
    /// All classes, in the order in which they are stored.
    pub const ALL: [Self; 5] = [Self::Pole, Self::Sign, Self::Light, Self::Lane, Self::Vegetation];

    /// Its name in files and folders: `pole`, `sign`, `light`, `lane`, `vegetation`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pole => "pole",
            Self::Sign => "sign",
            Self::Light => "light",
            Self::Lane => "lane",
            Self::Vegetation => "vegetation",
        }
    }
}

/// One value per pixel, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plane {
    width: usize,
    data: Vec<u8>,
}

impl Plane {
    /// A plane of `data` rows of `width` values; none where they do not fill
    /// whole rows.
    pub fn new(width: usize, data: Vec<u8>) -> Option<Self> {
        (width > 0 && data.len().is_multiple_of(width)).then_some(Self { width, data })
    }

    /// A plane of zeros.
    pub fn zeros(width: usize, height: usize) -> Self {
        let width = width.max(1);
        Self { width, data: vec![0; width * height] }
    }

    /// Values per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.data.len() / self.width
    }

    /// All values, row by row.
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// All values, row by row, to be changed.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data
    }

    /// The same plane of another size, each value the mean of what it covers; as it is
    /// where that is its own.
    #[must_use]
    pub fn resized(self, (width, height): (usize, usize)) -> Self {
        if (width, height) == (self.width, self.height()) {
            return self;
        }
        let size = (self.width, self.height());
        Self { width, data: super::image::resized(&self.data, PixelType::U8, size, (width, height)) }
    }

    /// One row; empty outside the plane.
    pub fn row(&self, y: usize) -> &[u8] {
        self.data.get(y * self.width..(y + 1) * self.width).unwrap_or_default()
    }

    /// The value nearest to (`x`, `y`) in pixels; zero outside the plane.
    pub fn at(&self, x: f64, y: f64) -> u8 {
        // NaN and everything below -0.5 fail the comparisons.
        let inside = x >= -0.5 && y >= -0.5 && x < self.width as f64 - 0.5 && y < self.height() as f64 - 0.5;
        if inside { self.data[(y + 0.5) as usize * self.width + (x + 0.5) as usize] } else { 0 }
    }
}

/// The probabilities of all [classes](Class) of one image, each at the size
/// of the image; zeros for a class that nothing tells about.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProbabilityMaps {
    planes: [Plane; Class::ALL.len()],
}

impl ProbabilityMaps {
    /// Zeros for an image of this size, pixels.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self { planes: Class::ALL.map(|_| Plane::zeros(width, height)) }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.planes[0].width()
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.planes[0].height()
    }

    /// The probabilities of a class.
    pub fn plane(&self, class: Class) -> &Plane {
        &self.planes[class as usize]
    }

    /// The largest of the probabilities of each pixel, vegetation aside: what
    /// grows has no shape that can be followed.
    pub fn largest(&self) -> Plane {
        let mut largest = self.plane(Class::Pole).clone();
        for class in [Class::Sign, Class::Light, Class::Lane] {
            for (value, other) in largest.data.iter_mut().zip(&self.plane(class).data) {
                *value = (*value).max(*other);
            }
        }
        largest
    }

    /// The largest of all.
    pub fn largest_value(&self) -> u8 {
        self.planes.iter().flat_map(Plane::data).copied().max().unwrap_or(0)
    }

    /// The same for an image of another size, pixels.
    #[must_use]
    pub fn resized(self, size: (usize, usize)) -> Self {
        Self { planes: self.planes.map(|plane| plane.resized(size)) }
    }

    /// Replaces the probabilities of a class.
    ///
    /// # Errors
    /// [`Error::PlaneSize`] where `plane` has another size than these maps.
    pub fn set(&mut self, class: Class, plane: Plane) -> Result<(), Error> {
        let (found, expected) = ((plane.width(), plane.height()), (self.width(), self.height()));
        if found != expected {
            return Err(Error::PlaneSize { class: class.name(), found, expected });
        }
        self.planes[class as usize] = plane;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_of_another_size_is_refused() {
        let mut maps = ProbabilityMaps::zeros(4, 3);
        assert!(maps.set(Class::Lane, Plane::zeros(4, 3)).is_ok());
        let error = maps.set(Class::Lane, Plane::zeros(3, 4)).unwrap_err().to_string();
        assert!(error.contains("lane") && error.contains("3x4") && error.contains("4x3"), "{error}");
    }

    #[test]
    fn the_largest_is_that_of_any_class_but_vegetation() {
        let mut maps = ProbabilityMaps::zeros(3, 1);
        maps.set(Class::Pole, Plane::new(3, vec![9, 0, 3]).unwrap()).unwrap();
        maps.set(Class::Lane, Plane::new(3, vec![4, 7, 3]).unwrap()).unwrap();
        maps.set(Class::Vegetation, Plane::new(3, vec![99, 99, 99]).unwrap()).unwrap();
        assert_eq!(maps.largest().data(), [9, 7, 3]);
    }

    #[test]
    fn outside_is_zero() {
        let plane = Plane::new(2, vec![1, 2, 3, 4]).unwrap();
        assert_eq!(plane.at(1.4, 0.6), 4);
        assert_eq!((plane.at(1.5, 0.0), plane.at(-0.6, 0.0), plane.at(f64::NAN, 0.0)), (0, 0, 0));
        assert!(plane.row(2).is_empty());
        assert!(Plane::new(2, vec![0; 3]).is_none());
    }
}
