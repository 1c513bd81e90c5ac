//! Images in memory, and PNG files.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use common::geometry::PinholeCamera;

use super::{Error, Plane};

/// A colour image, row by row, three bytes per pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    width: usize,
    data: Vec<u8>,
}

impl RgbImage {
    /// An image of `data` rows of `width` pixels, three bytes each; none where
    /// they do not fill whole rows.
    pub fn new(width: usize, data: Vec<u8>) -> Option<Self> {
        (width > 0 && data.len().is_multiple_of(3 * width)).then_some(Self { width, data })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.data.len() / (3 * self.width)
    }

    /// All values: red, green, blue of the first pixel of the first row, ...
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// One row, red, green, blue of its first pixel first; empty outside.
    pub fn row(&self, y: usize) -> &[u8] {
        self.data.get(3 * y * self.width..3 * (y + 1) * self.width).unwrap_or_default()
    }

    /// Its brightness: the mean of red, green and green, and blue, as the
    /// sensor has twice as many green pixels.
    pub fn grey(&self) -> Plane {
        let mut plane = Plane::zeros(self.width, self.height());
        for (grey, rgb) in plane.data_mut().iter_mut().zip(self.data.chunks_exact(3)) {
            *grey = ((u16::from(rgb[0]) + 2 * u16::from(rgb[1]) + u16::from(rgb[2]) + 2) / 4) as u8;
        }
        plane
    }

    /// The three bytes of a pixel, none outside the image.
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> Option<&mut [u8]> {
        if x >= self.width {
            return None;
        }
        let at = 3 * (y * self.width + x);
        self.data.get_mut(at..at + 3)
    }
}

/// Largest distance of the principal point from the middle of an image that
/// was neither scaled nor cropped, as a share of its size: rectified KITTI
/// images have at most 0.02, a half-size image has 0.5.
const OFF_CENTRE: f64 = 0.15;

/// Checks that an image of this size can be the one that `camera` was
/// calibrated for. KITTI's calibration files do not say the size, so this
/// asks that the optical axis meets the image near its middle.
///
/// # Errors
/// [`Error::OffCentre`] where it does not.
pub fn check_calibration(path: &Path, size: (usize, usize), camera: &PinholeCamera) -> Result<(), Error> {
    let off = |principal: f64, pixels: usize| (principal / pixels as f64 - 0.5).abs() > OFF_CENTRE;
    if off(camera.cx_px, size.0) || off(camera.cy_px, size.1) {
        let principal_point_px = (camera.cx_px, camera.cy_px);
        return Err(Error::OffCentre { path: path.into(), found: size, principal_point_px });
    }
    Ok(())
}

/// Checks that an image has the size of the others.
///
/// # Errors
/// [`Error::ImageSize`] where it has another.
pub fn check_size(path: &Path, found: (usize, usize), expected: (usize, usize)) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::ImageSize { path: path.into(), found, expected }) }
}

/// Reads a colour or grey PNG of any depth as 8-bit RGB; transparency is
/// dropped.
///
/// # Errors
/// [`common::Error::Io`] where it cannot be opened, [`Error::Decode`] where
/// it is no intact PNG.
pub fn read_png(path: impl AsRef<Path>) -> Result<RgbImage, Error> {
    let path = path.as_ref();
    let (width, colour, data) = decode(path)?;
    let samples = colour.samples();
    let data = match colour {
        png::ColorType::Rgb => data,
        png::ColorType::Rgba => data.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
        _ => data.chunks_exact(samples).flat_map(|p| [p[0]; 3]).collect(),
    };
    RgbImage::new(width, data).ok_or_else(|| pixel_kind(path, colour, "8-bit RGB"))
}

/// Writes an 8-bit RGB PNG, whole or not at all.
///
/// # Errors
/// [`common::Error::Io`] or [`Error::Encode`] where it cannot be written.
pub fn write_png(path: impl AsRef<Path>, image: &RgbImage) -> Result<(), Error> {
    encode(path.as_ref(), (image.width(), image.height()), png::ColorType::Rgb, image.data())
}

/// Reads an 8-bit grey PNG.
///
/// # Errors
/// As [`read_png`], and [`Error::PixelKind`] where it is no 8-bit grey image:
/// a colour picture of probabilities has no agreed meaning.
pub fn read_grey_png(path: impl AsRef<Path>) -> Result<Plane, Error> {
    let path = path.as_ref();
    let (width, colour, data) = decode(path)?;
    let refused = || pixel_kind(path, colour, "8-bit grey");
    if colour != png::ColorType::Grayscale {
        return Err(refused());
    }
    Plane::new(width, data).ok_or_else(refused)
}

/// Writes an 8-bit grey PNG, whole or not at all.
///
/// # Errors
/// As [`write_png`].
pub fn write_grey_png(path: impl AsRef<Path>, plane: &Plane) -> Result<(), Error> {
    encode(path.as_ref(), (plane.width(), plane.height()), png::ColorType::Grayscale, plane.data())
}

fn pixel_kind(path: &Path, colour: png::ColorType, expected: &'static str) -> Error {
    Error::PixelKind { path: path.into(), found: format!("{colour:?}"), expected }
}

fn decode(path: &Path) -> Result<(usize, png::ColorType, Vec<u8>), Error> {
    let failed = |source| Error::Decode { path: path.into(), source };
    let file = File::open(path).map_err(common::Error::io(path))?;
    let mut decoder = png::Decoder::new(BufReader::new(file));
    // To 8 bits per channel, palettes resolved.
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(failed)?;
    let bytes = reader.output_buffer_size().ok_or_else(|| failed(png::DecodingError::LimitsExceeded))?;
    let mut data = vec![0; bytes];
    let frame = reader.next_frame(&mut data).map_err(failed)?;
    data.truncate(frame.buffer_size());
    Ok((frame.width as usize, frame.color_type, data))
}

fn encode(path: &Path, size: (usize, usize), colour: png::ColorType, data: &[u8]) -> Result<(), Error> {
    let failed = |source| Error::Encode { path: path.into(), source };
    // PNG knows no larger images; the encoder refuses the wrong length.
    let (width, height) = (u32::try_from(size.0).unwrap_or(0), u32::try_from(size.1).unwrap_or(0));
    common::atomic_file::write_with(path, |out| {
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(colour);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(data).map_err(failed)?;
        writer.finish().map_err(failed)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn images_and_planes_survive_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let image = RgbImage::new(2, (0..18).collect()).unwrap();
        write_png(&path, &image).unwrap();
        assert_eq!(read_png(&path).unwrap(), image);
        let refused = read_grey_png(&path).unwrap_err().to_string();
        assert!(refused.contains("a.png") && refused.contains("8-bit grey"), "{refused}");
        let plane = Plane::new(3, (0..12).collect()).unwrap();
        write_grey_png(&path, &plane).unwrap();
        assert_eq!(read_grey_png(&path).unwrap(), plane);
        assert_eq!(read_png(&path).unwrap().row(1), &[3, 3, 3, 4, 4, 4, 5, 5, 5]);
    }

    #[test]
    fn a_broken_png_is_an_error_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.png");
        let image = RgbImage::new(40, vec![7; 3600]).unwrap();
        write_png(&path, &image).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 20, bytes.len() / 2] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(read_png(&path).unwrap_err().to_string().contains("broken.png"));
        }
        assert!(read_png(folder.path().join("absent.png")).unwrap_err().to_string().contains("absent.png"));
    }

    #[test]
    fn a_scaled_image_does_not_fit_the_calibration() {
        let camera = PinholeCamera {
            fx_px: 718.856,
            fy_px: 718.856,
            cx_px: 607.19,
            cy_px: 185.22,
            from_reference_m: Vector3::zeros(),
        };
        let path = Path::new("000000.png");
        assert!(check_calibration(path, (1226, 370), &camera).is_ok());
        let error = check_calibration(path, (613, 185), &camera).unwrap_err().to_string();
        assert!(error.contains("000000.png has 613x185 px"), "{error}");
        let error = check_size(path, (1241, 376), (1226, 370)).unwrap_err().to_string();
        assert!(error.contains("1241x376") && error.contains("1226x370"), "{error}");
    }
}
